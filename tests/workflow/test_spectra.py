# SPDX-License-Identifier: LGPL-3.0-or-later
"""Spectra of known oscillations; modal participation against closed forms and the run itself."""

import shutil

import h5py
import numpy as np
import pytest

from workflow import Scene, run
from workflow.modes.modes import modes
from workflow.results import participation as modal
from workflow.results import spectra
from workflow.results.samples import read as read_samples
from workflow.scene.scene import SceneError

E, RHO, LENGTH, WIDTH = 210e9, 7800.0, 0.1, 0.005
C = np.sqrt(E / RHO)
MASS = RHO * LENGTH * WIDTH**2
RATE = 1e5


def means(f: float, t: np.ndarray, interval: float) -> np.ndarray:
    """Means of ``cos(2 π f t)`` over windows about t, by the integral."""
    return (
        np.sin(2 * np.pi * f * (t + interval / 2)) - np.sin(2 * np.pi * f * (t - interval / 2))
    ) / (2 * np.pi * f * interval)


@pytest.mark.parametrize("f", [1000.0, 4000.0, 10000.0])
def test_amplitude_of_a_known_oscillation(f):
    """Peak at f, mean square 1/2 once the window's mean is corrected, to 1 %."""
    t = (np.arange(2000) + 0.5) / RATE
    got = spectra.spectrum(means(f, t, 1 / RATE), 1 / RATE)
    assert got.resolution == pytest.approx(50.0)
    assert abs(got.frequency[np.argmax(got.density)] - f) < got.resolution
    power = (got.density**2)[np.abs(got.frequency - f) < 500].sum() * got.resolution
    assert power == pytest.approx(0.5, rel=0.01)


def test_white_noise_has_its_density():
    """Of variance 1 over 50 kHz: 1/√(50 kHz); windows are its own means, so there is no filter."""
    x = np.random.default_rng(1).normal(size=(40000, 3))
    got = spectra.spectrum(x, 1 / RATE)
    gain = spectra.filtering(got.frequency, 1 / RATE)[:, None]
    level = np.sqrt(((got.density * gain) ** 2).mean(axis=0))
    np.testing.assert_allclose(level, 1 / np.sqrt(RATE / 2), rtol=0.02)
    assert got.segments == 39


def test_alias_is_as_large_as_told():
    """An oscillation at 1/T - f shows up at f with f T / (1 - f T) of its size."""
    t, f = (np.arange(2000) + 0.5) / RATE, 10e3
    peak = [spectra.spectrum(means(g, t, 1 / RATE), 1 / RATE).density.max() for g in (f, RATE - f)]
    assert peak[1] / peak[0] == pytest.approx(spectra.leakage(f, 1 / RATE), rel=1e-3)
    assert spectra.leakage(f, 1 / RATE) == pytest.approx(1 / 9)


def test_trend_and_units():
    """Cubics leave nothing; a velocity is the same from displacement and acceleration."""
    t = np.linspace(0, 1, 300)
    assert np.abs(spectra.detrended(1 + t - 3 * t**2 + 2 * t**3)).max() < 1e-13
    t = (np.arange(1000) + 0.5) / RATE
    f, omega = 5000.0, 2 * np.pi * 5000.0
    peaks = []
    for quantity, power in (("displacement", -1), ("velocity", 0), ("acceleration", 1)):
        got = spectra.spectrum(omega**power * means(f, t, 1 / RATE), 1 / RATE)
        peaks.append(spectra.as_velocity(got, quantity).max())
    np.testing.assert_allclose(peaks, peaks[0], rtol=1e-10)
    assert spectra.spectrum(np.zeros(5), 1e-5) is None


def test_row_4_peaks_of_a_ringing_bar(tmp_path):
    """Clamped-free bar let go with uniform velocity: peaks at (2k - 1) c / 4L, sizes 1 / (2k - 1).

    v = 4/π Σ (-1)^(k+1) / (2k - 1) cos((2k - 1) π c t / 2L) at the free end, so lines stand as
    1, 1/3, 1/5 (2 %, mesh and step); found within half a line.
    """
    scene = Scene.load("bar-wave", **{"mesh.size": 2.5e-3, "time.end": 1.2e-3})
    tables = scene.tables() | {"probes": [{"name": "end", "surface": "xmax"}]}
    tables["output"] |= {"sample_interval": 1e-6, "fields": False, "checkpoint_minutes": 0.0}
    tables["time"]["output_interval"] = 1.2e-4
    run(Scene.check(tables), tmp_path / "run", quiet=True)
    samples = read_samples(tmp_path / "run")
    got = spectra.spectrum(samples.motion["end"][:, 0], samples.interval)
    size = []
    for k in (1, 2, 3):
        near = np.abs(got.frequency / ((2 * k - 1) * C / 4 / LENGTH) - 1) < 0.15
        at = np.argmax(np.where(near, got.density, 0))
        assert abs(got.frequency[at] - (2 * k - 1) * C / 4 / LENGTH) < 1.5 * got.resolution
        size.append(np.sqrt((got.density[at - 3 : at + 4] ** 2).sum() * got.resolution * 2))
    np.testing.assert_allclose(np.array(size) * [1, 3, 5], 4 / np.pi, rtol=0.02)


@pytest.mark.parametrize("f", [500.0, 3000.0, 10000.0])
def test_vibration_after_steps_and_pulses(f):
    """Step of 3 N at the start: 3/ω ever after; struck down again after t: 2·3/ω |sin(ω t / 2)|."""
    omega, n = 2 * np.pi * f, 400
    starts = np.arange(n) / RATE
    force = np.where(np.arange(n) < 137, 3.0, 0.0)[None]
    moved = np.abs(modal.vibration(force, np.array([f]), starts, 1 / RATE, struck=True))[0]
    gain = spectra.filtering(f, 1 / RATE) ** 2  # steps at the edges of windows are not filtered
    np.testing.assert_allclose(moved[:137] * gain, 3 / omega, rtol=1e-12)
    after = 6 / omega * abs(np.sin(omega * 137 / RATE / 2))
    np.testing.assert_allclose(moved[137:] * gain, after, atol=1e-12 * 3 / omega)
    quiet = modal.vibration(force, np.array([f]), starts, 1 / RATE)[0]
    assert np.abs(quiet[:137]).max() == 0.0


@pytest.mark.parametrize("f", [1000.0, 8000.0])
def test_resonance_grows_with_time(f):
    """``Q = sin ω t`` on a mode of the same ω: about ``t / 2`` after many periods, to 1 %."""
    starts = np.arange(4000) / RATE
    force = means_of_sine(f, starts + 0.5 / RATE)[None]
    moved = np.abs(modal.vibration(force, np.array([f]), starts, 1 / RATE))[0]
    np.testing.assert_allclose(moved[2000:], starts[2000:] / 2, rtol=0.01)


def means_of_sine(f: float, t: np.ndarray) -> np.ndarray:
    """Means of ``sin(2 π f t)`` over windows of 1/RATE about t."""
    return np.sin(2 * np.pi * f * t) * np.sinc(f / RATE)


def test_weights_find_a_point_in_a_warped_cell():
    """Trilinear weights give the point back and sum to 1."""
    rng = np.random.default_rng(2)
    cube = np.array([[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))])
    corners = cube + rng.uniform(-0.15, 0.15, (8, 3))
    for xi in rng.uniform(0, 1, (20, 3)):
        share = np.prod(np.where(cube == 1, xi, 1 - xi), axis=1)
        np.testing.assert_allclose(modal.weights(corners, share @ corners), share, atol=1e-9)


@pytest.fixture(scope="module")
def struck(tmp_path_factory):
    """A bar that hits a wall with 1 m/s, up to 1.5 L/c, and its free modes up to 90 kHz."""
    root = tmp_path_factory.mktemp("bar")
    # damped, or the contact spring ripples by 5 % of the force, which rings in all modes
    tables = Scene.load("bar-impact", **{"contacts.wall.damping": 0.5}).tables()
    tables["time"] |= {"end": 1.5 * LENGTH / C, "output_interval": 0.1 * LENGTH / C}
    tables["output"] |= {"sample_interval": 1e-7}
    scene = Scene.check(tables)
    run(scene, root / "run", quiet=True)
    modes(scene, root / "bar-impact-modes", top=90e3)
    return root, scene


def longitudinal(found: modal.ModeShapes) -> dict[int, int]:
    """Row of each longitudinal mode by its number of half waves."""
    return {
        round(row["frequency"] * 2 * LENGTH / C): i
        for i, row in enumerate(found.rows)
        if row["shares"]["x"] > 0.9
    }


def test_bar_that_hits_a_wall_rings_as_the_closed_form_says(struck):
    r"""Force ``ρ c v A`` at the end, ``φ_k = √(2/m) cos(k π x / L)``: ``|w_k| = √(2 m) v / (k π)``.

    Over 0.3 to 1.4 L/c its rms is 0.2, 0.9 and 1.9 % less for k = 1, 2, 3, in proportion to k²: the
    force takes the transit of a cell to rise. Bending modes get 1e-6 of that.
    """
    root, scene = struck
    samples = read_samples(root / "run")
    found = modal.found(root / "run", scene, None)
    got = modal.participation(found, samples, samples.pairs["wall"], scene)
    assert modal.fits(found, scene, samples.pairs["wall"])
    whole = (got.t > 0.3 * LENGTH / C) & (got.t < 1.4 * LENGTH / C)
    rows = longitudinal(found)
    assert sorted(rows) == [1, 2, 3]
    for k, i in rows.items():
        size = np.sqrt((np.abs(got.vibration[i, whole]) ** 2).mean())
        exact = np.sqrt(2 * MASS) / (k * np.pi)
        assert -0.0025 * k**2 < size / exact - 1 < 0
    others = np.delete(np.arange(len(found.rows)), list(rows.values()))
    assert np.abs(got.vibration[others]).max() < 1e-6 * np.abs(got.vibration).max()


def test_participation_is_what_the_field_does(struck):
    """``q̇ + i ω (q - Q / ω²)`` from displacements and velocities of the whole bar, by φᵀ M.

    Independent of contact forces but for Q; within 0.1 % of the largest.
    """
    root, scene = struck
    samples = read_samples(root / "run")
    found = modal.found(root / "run", scene, None)
    got = modal.participation(found, samples, samples.pairs["wall"], scene)
    mass = np.bincount(found.cells.ravel(), minlength=len(found.points)) * MASS
    mass = mass / 8 / len(found.cells)
    with h5py.File(root / "run" / "fields.vtkhdf") as file:
        top = file["VTKHDF"]
        n = len(top["Points"])
        np.testing.assert_allclose(top["Points"][:], found.points, atol=1e-12)
        times = top["Steps/Values"][:]
        u, v = (
            top[f"PointData/{name}"][:].reshape(-1, n, 3) for name in ("displacement", "velocity")
        )
    for i in longitudinal(found).values():
        omega = 2 * np.pi * found.frequency[i]
        weight = mass[:, None] * found.shapes[i]
        assert (weight * found.shapes[i]).sum() == pytest.approx(1.0, rel=1e-5)
        q, rate = (np.einsum("tni,ni->t", x, weight) for x in (u, v))
        later = times[2:-1]
        force = np.interp(later, samples.t, got.force[i])
        field = np.abs(rate[2:-1] + 1j * (omega * q[2:-1] - force / omega))
        size = np.interp(later, got.t, np.abs(got.vibration[i]))
        np.testing.assert_allclose(size, field, rtol=0, atol=0.002 * field.max())


def test_forces_are_turned_into_the_wheel():
    """A force that stays while the wheel turns goes backwards round it."""
    spin = np.array([0.0, 50.0, 0.0])
    t = np.array([0.0, np.pi / 100])  # a quarter turn
    got = spectra.turned(np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]]), t, spin)
    np.testing.assert_allclose(got, [[0, 0, 1], [-1, 0, 0]], atol=1e-12)


def test_modes_that_do_not_belong(struck, tmp_path):
    """A folder without modes is refused by name; modes of another body are not used."""
    root, scene = struck
    with pytest.raises(SceneError, match=r"--modes .*: expected a folder of squealx modes"):
        modal.found(root / "run", scene, tmp_path)
    assert modal.found(tmp_path / "run", scene, None) is None
    found = modal.found(root / "run", scene, None)
    with pytest.raises(SceneError, match="away from that part"):
        modal.at_points(found, np.array([[0.2, 0.0, 0.0]]))
    found.summary["part"] = "rail"
    samples = read_samples(root / "run")
    assert not modal.fits(found, scene, samples.pairs["wall"])


def test_figures(struck, tmp_path):
    """Three more, with modes found beside the run; none for a run that was not sampled."""
    from workflow.figures.spectra import modal_participation, sampled_forces, sampled_spectra
    from workflow.results.record import Record

    root, _ = struck
    figures = (sampled_forces, sampled_spectra, modal_participation)
    forces, lines, part = (figure(Record(root / "run")) for figure in figures)
    assert "means over" in forces.get_suptitle()
    assert "lines every" in lines.get_suptitle()
    assert any("along x" in text.get_text() for text in part.axes[0].texts)
    for name in ("scene.toml", "results.h5"):
        shutil.copy(root / "run" / name, tmp_path)
    with h5py.File(tmp_path / "results.h5", "r+") as file:
        del file["probes"]
    assert not any(figure(Record(tmp_path, root / "bar-impact-modes")) for figure in figures)
