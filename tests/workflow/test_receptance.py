# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs under a hammer: transfer function, damping, decay rate, beams behind them, bad input."""

import json
from dataclasses import replace

import numpy as np
import pytest
import tomli_w

from workflow import Scene, run
from workflow.results.receptance import bands, decay_rates, peaks, receptance
from workflow.results.record import Record
from workflow.scene.scene import SceneError
from workflow.theory.track_beam import TrackBeam, fit_track, of_scene

MASS, STIFFNESS, DAMPING = 7800.0 * 0.1 * 0.05**2, 1e6, 150.0
STEEL = {"youngs_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}
HAMMER = {"point": [0.1, 0.02, 0.02], "radius": 0.04}
HAMMER |= {"force": [1e3, 0.0, 0.0], "duration": 2e-3}
ROW_41 = {20: 1.019e-8, 100: 7.56e-9, 200: 1.673e-9, 500: 4.04e-10, 1000: 1.651e-9, 2000: 3.28e-10}


def block(**changes) -> Scene:
    """A small steel block on a spring and damper along x, hit on its end along x."""
    tables = {
        "name": "block",
        "title": "A block on a spring under a hammer",
        "mesh": {"kind": "bar", "length": 0.1, "width": 0.05, "size": 0.05},
        "bodies": {"block": {"regions": ["bar"], "material": STEEL}},
        "springs": [
            {"surface": "xmin", "stiffness": [STIFFNESS, 0.0, 0.0], "damping": [DAMPING, 0.0, 0.0]}
        ],
        "loads": [{"surface": "xmax", "hammer": HAMMER}],
        "probes": [
            {"name": "end", "surface": "xmax", "quantity": "displacement"},
            {"name": "speed", "surface": "xmax", "quantity": "velocity"},
        ],
        "time": {"end": 0.25, "output_interval": 0.05},
        "output": {"fields": False, "sample_interval": 2e-4},
    }
    return Scene.check(tables).with_(**changes)


def oscillator(f: np.ndarray) -> np.ndarray:
    """Its receptance as a rigid mass [m/N]."""
    omega = 2 * np.pi * f
    return 1 / (STIFFNESS - MASS * omega**2 + 1j * omega * DAMPING)


@pytest.fixture(scope="module")
def struck(tmp_path_factory):
    folder = tmp_path_factory.mktemp("struck") / "run"
    run(block(), folder, quiet=True)
    return folder


def test_receptance_of_a_mass_on_a_spring(struck):
    """1 / (k - m ω² + i ω c) from 20 to 300 Hz: 1 %; from velocities as from displacements.

    Damping c / 2 √(k m) = 5.4 % by half power: 1 % of it. exp(-38 · 0.25) of the motion is left.
    """
    found = receptance(Record(struck), 20.0, 300.0)
    exact = oscillator(found.frequency)
    for value in found.value:
        assert (np.abs(value - exact) / np.abs(exact)).max() < 0.01
    assert 0 < found.cut_off.max() < 0.01
    (peak,) = peaks(found.frequency, found.value[0])
    assert peak["frequency"] == pytest.approx(np.sqrt(STIFFNESS / MASS) / (2 * np.pi), rel=5e-3)
    assert peak["damping"] == pytest.approx(DAMPING / 2 / np.sqrt(STIFFNESS * MASS), rel=0.01)
    assert not found.rows


def test_what_the_end_of_the_record_cuts_off_is_told(tmp_path):
    """A record of 25 ms, in which half is left of the response: tens of per cent."""
    run(block(**{"time.end": 0.025, "time.output_interval": 0.005}), tmp_path / "run", quiet=True)
    found = receptance(Record(tmp_path / "run"), 50.0, 300.0)
    off = np.abs(found.value[0] / oscillator(found.frequency) - 1)
    assert off.max() > 0.3
    assert found.cut_off[0][off > 0.3].min() > 0.02


def test_receptance_command(struck, command):
    """One JSON object; a table of all lines and a figure beside the run."""
    told = json.loads(command("receptance", struck, "--to", 300, "--json").stdout)
    assert set(told["probes"]) == {"end", "speed"} and told["decay"] == {}
    probe = told["probes"]["end"]
    exact = np.abs(oscillator(np.array(told["frequency"])))
    np.testing.assert_allclose(probe["magnitude"], exact, rtol=0.01)
    lines = np.loadtxt(struck / "receptance.csv", delimiter=",", skiprows=1)
    assert lines.shape[1] == 7
    np.testing.assert_allclose(lines[:, 1], np.abs(oscillator(lines[:, 0])), rtol=0.01)
    assert (struck / "figures" / "receptance.png").stat().st_size > 10_000
    drawn = json.loads(command("figures", struck, "--json").stdout)["figures"]
    assert [name for name in drawn if "receptance" in name]
    assert not [name for name in drawn if "spectra" in name]


@pytest.mark.mpi
def test_two_ranks_are_struck_as_one(struck, tmp_path, mpirun):
    """The same displacement to 1e-9 of its largest."""
    path = tmp_path / "block.toml"
    path.write_text(tomli_w.dumps(block(**{"time.end": 0.05}).tables()))
    mpirun(2, "-m", "workflow.cli", "run", path, "--out", tmp_path / "two")
    one = receptance(Record(tmp_path / "two"), 50.0, 300.0).value
    run(block(**{"time.end": 0.05}), tmp_path / "one", quiet=True)
    other = receptance(Record(tmp_path / "one"), 50.0, 300.0).value
    assert np.abs(one - other).max() < 1e-9 * np.abs(one).max()


def test_peaks_and_their_half_power():
    """Two modes of 1 and 3 % a decade apart; a record without peaks has none."""
    f = np.arange(10.0, 1000.0, 0.1)
    modes = [1 / (k**2 - f**2 + 2j * z * k * f) for k, z in ((50.0, 0.01), (500.0, 0.03))]
    first, second = peaks(f, modes[0] + 5 * modes[1])
    assert (first["frequency"], first["damping"]) == pytest.approx((50.0, 0.01), rel=0.01)
    assert (second["frequency"], second["damping"]) == pytest.approx((500.0, 0.03), rel=0.02)
    assert peaks(f, 1 / (2e3**2 - f**2 + 0j)) == []


def test_decay_rate_of_a_wave():
    """exp(-β x) with 8.686 β dB/m, fine probes to 40 dB: 1 %. Bands by their nominal middles."""
    x, f = np.arange(0.0, 10.0, 0.05), np.geomspace(80.0, 600.0, 200)
    middles = bands(100.0, 500.0)
    np.testing.assert_allclose(middles[[0, 1, -1]], [100, 125.9, 501.2], rtol=1e-3)
    rate = decay_rates(f, np.exp(-0.5 * x)[:, None] * np.ones(200), x, middles)
    np.testing.assert_allclose(rate, 8.686 * 0.5, rtol=0.01)


# beams


@pytest.fixture(scope="module")
def beam() -> TrackBeam:
    found = of_scene(Scene.load("track-hammer"))
    assert found is not None
    return found


def test_row_41_beam_on_two_layers(beam):
    """Receptances of row 41 and 0.803 mm under 84 kN, in closed form: to the digits given."""
    assert beam.bending == pytest.approx(4.910e6, rel=1e-3)
    assert (beam.mass, beam.sleeper) == pytest.approx((54.77, 219.0), rel=1e-3)
    found = np.abs(replace(beam, sleeper=219.0).receptance(np.array([*ROW_41])))
    np.testing.assert_allclose(found, [*ROW_41.values()], rtol=1.3e-3)
    assert 84e3 * abs(beam.receptance(np.zeros(1))[0]) == pytest.approx(0.803e-3, rel=1e-3)


def test_sleepers_close_together_are_two_even_layers(beam):
    """A sixth of everything at a sixth of the spacing, a rail stiff in shear: 1.5 % to 2 kHz."""
    parts = ("spacing", "seat", "sleeper", "pad_stiffness", "pad_damping", "ballast_stiffness")
    close = {key: getattr(beam, key) / 6 for key in (*parts, "ballast_damping")}
    near = replace(beam, **close, shearing=1e13, rotary=0.0)
    f, x = np.array([100.0, 500.0, 1000.0, 2000.0]), np.array([0.0, 0.4])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("workflow.theory.track_beam.BESIDE", 80)
        found = near.on_sleepers(f, 0.0, x)
    np.testing.assert_allclose(found, near.receptance(f, x), rtol=0.015)


def test_the_rail_alone_is_a_beam(beam):
    """A free rail at 1 Hz: Bernoulli's running and decaying wave, Σ F / (4 i E I k³), 1e-3."""
    k = (beam.mass * (2 * np.pi) ** 2 / beam.bending) ** 0.25 * np.array([1, -1j])
    exact = (1 / (4j * beam.bending * k**3)).sum()
    assert beam.free(2 * np.pi, np.zeros(1))[0] == pytest.approx(exact, rel=1e-3)


def test_fit_finds_pads_and_ballast(beam, tmp_path):
    """A curve of known pads and ballast, from guesses off by 3: found to 1 %."""
    f = np.geomspace(30.0, 1500.0, 30)
    size = np.abs(beam.on_sleepers(f, 0.3, np.array([0.3]))[0])
    path = tmp_path / "curve.csv"
    np.savetxt(path, np.column_stack([f, size]), delimiter=",", header="frequency,magnitude")
    guess = replace(beam, pad_stiffness=4e8, pad_damping=1e5, ballast_stiffness=1e8)
    found = fit_track(guess, path, 0.3)
    for key in ("pad_stiffness", "pad_damping", "ballast_stiffness", "ballast_damping"):
        assert getattr(found, key) == pytest.approx(getattr(beam, key), rel=0.01)
    path.write_text("frequency\n20\n30\n")
    with pytest.raises(ValueError, match="expected frequency, magnitude"):
        fit_track(guess, path, 0.3)


# bad input


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ramp": 1e-3}, "loads: hammer: expected a force, without .* got both"),
        ({"hammer": HAMMER | {"force": [0.0, 0.0, 0.0]}}, "loads: hammer: .* got none"),
        ({"hammer": HAMMER | {"duration": 0.0}}, "loads.0.hammer.duration = 0.0: expected"),
        ({"surface": "top"}, "loads.0.surface = 'top': expected one of"),
    ],
)
def test_a_hammer_that_cannot_strike(changes, message):
    """The key, what it got and what it expects."""
    with pytest.raises(SceneError, match=message):
        block(loads=[{"surface": "xmax", "hammer": HAMMER} | changes])


def test_a_hammer_that_misses(tmp_path):
    """The radius that would do is told."""
    missed = block(loads=[{"surface": "xmax", "hammer": HAMMER | {"radius": 1e-3}}])
    with pytest.raises(SceneError, match=r"loads.0.hammer.radius = 0.001: expected 0.0283 m or"):
        run(missed, tmp_path / "run", quiet=True)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mesh.size": 0.002}, "mesh.size = 0.002: expected 3e-3 to 24e-3 m"),
        ({"mesh.rail_length": 0.5}, "mesh.rail_length = 0.5: expected a stretch between"),
    ],
)
def test_a_rail_that_cannot_be_meshed(changes, message):
    """As told by ``validate``, before anything is meshed."""
    from workflow.model.checks import check

    with pytest.raises(SceneError, match=message):
        check(Scene.load("track-hammer", **changes))


def test_a_run_without_blow_and_frequencies_out_of_range(struck, tmp_path, command):
    """Exit code 2; the option or key is named."""
    with pytest.raises(SceneError, match=r"--from 20 --to 3000: expected .* up to 1988 Hz"):
        receptance(Record(struck), 20.0, 3000.0)
    changes = {"loads": [], "time.end": 1e-3, "time.output_interval": 1e-3}
    run(block(**changes), tmp_path / "run", quiet=True)
    done = command("receptance", tmp_path / "run", check=False)
    assert done.returncode == 2
    assert "loads: expected one with a hammer, got 0" in done.stderr
