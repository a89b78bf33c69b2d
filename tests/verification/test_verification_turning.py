# SPDX-License-Identifier: LGPL-3.0-or-later
"""Verification row 42: a turning disc seen from the track, by eigenvalues and by time."""

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from meshes.formats import read_write
from meshes.hexmesh import HexMesh, boundary
from meshes.tags import Tag
from workflow import Scene, run
from workflow.modes.labels import labelled
from workflow.modes.modes import modes
from workflow.results.samples import read
from workflow.results.turning import Rim, rim

BORE, EDGE, THICK, SPIN = 0.1, 0.3, 0.02, 300.0
PROBES = 16
STEEL = {"youngs_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}
# direction (axial 0, radial 1, circumferential 2), n, m: the modes that both roads are asked for
WANTED = [(0, 1, 0), (0, 2, 0), (0, 3, 0), (0, 4, 0), (0, 2, 1), (0, 3, 1)]
WANTED += [(1, 2, None), (1, 3, None), (1, 4, None)]
KINDS = ("axial", "radial", "circumferential")


def place(radius: float, angle: float, y: float) -> list[float]:
    """A point of the disc, its axle along y, angles about it."""
    return [radius * np.cos(angle), y, -radius * np.sin(angle)]


def disc(around: int = 48, through: int = 10) -> HexMesh:
    """A disc of one layer of cells, its bore and its edge marked."""
    angles, radii = 2 * np.pi * np.arange(around) / around, np.linspace(BORE, EDGE, through + 1)
    points = [
        place(r, angle, y) for y in (-THICK / 2, THICK / 2) for angle in angles for r in radii
    ]
    node = np.arange(len(points)).reshape(2, around, through + 1)
    near, far = (
        np.stack([n[:, :-1], n[:, 1:], m[:, 1:], m[:, :-1]], axis=-1).reshape(-1, 4)
        for n, m in zip(node, np.roll(node, -1, axis=1), strict=True)
    )
    cells, x = np.hstack([near, far]), np.array(points)
    facets = boundary(cells)
    radius = np.hypot(x[facets][..., 0], x[facets][..., 2])
    surfaces = np.full(len(facets), Tag.YMIN, dtype=np.int32)
    surfaces[(np.abs(radius - BORE) < 1e-9).all(axis=1)] = Tag.CAP
    surfaces[(np.abs(radius - EDGE) < 1e-9).all(axis=1)] = Tag.TREAD
    return HexMesh(x, cells, np.full(len(cells), Tag.BLOCK, dtype=np.int32), facets, surfaces)


def scene(folder: Path, end: float = 0.04) -> Scene:
    """The disc, turned at its bore, hit on its edge along the axle and inwards."""
    path = folder / "disc.msh"
    read_write.write(disc(), path)
    probes = [
        {
            "name": f"edge_{k}",
            "point": place(EDGE, 2 * np.pi * k / PROBES, THICK / 2),
            "surface": "tread",
            "quantity": "velocity",
        }
        for k in range(PROBES)
    ]
    hammer = {"point": [EDGE, 0.0, 0.0], "radius": 0.03}
    hammer |= {"force": [-3e3, 1e3, 0.0], "duration": 1e-4}
    return Scene.check(
        {
            "name": "turning-disc",
            "title": "A disc that turns, hit on its edge",
            "mesh": {"kind": "file", "path": str(path)},
            "bodies": {"disc": {"regions": ["block"], "element": "one-point", "material": STEEL}},
            "driven": {"disc": {"surface": "cap", "spin": [0.0, SPIN, 0.0]}},
            "loads": [{"surface": "tread", "hammer": hammer}],
            "probes": probes,
            "time": {"end": end, "output_interval": end / 5},
            "output": {"fields": False, "sample_interval": 2e-5},
        }
    )


def line(q: np.ndarray, t: np.ndarray, near: float, within: float) -> float:
    """The frequency of the largest line of a complex signal within some Hz, Hann window."""
    size = 16 * len(q)
    power = np.abs(np.fft.fft((q - q.mean()) * np.hanning(len(q)), size))
    f = np.fft.fftfreq(size, t[1] - t[0])
    found = np.flatnonzero(np.abs(f - near) < within)
    i = int(found[np.argmax(power[found])])
    a, b, c = np.log(power[[i - 1, i, (i + 1) % size]])
    return float(f[i] + (a - c) / 2 / (a - 2 * b + c) / (size * (t[1] - t[0])))


@pytest.mark.slow
def test_row_42_frequencies_seen_from_the_track(tmp_path):
    """f ± (n - c) Ω/2π, c what Coriolis forces take: both roads within 0.1 % of each other.

    At 300 rad/s, which carries n = 2 by 95.5 Hz. Axial motion feels c = 0.007 to 0.03, so that it
    is the n Ω/2π of row 42 within 1.5 %; radial motion c = 0.98, 0.69, 0.47 at n = 2, 3, 4. The
    middle of both lies up to 1.2 % above the frequency at rest: centrifugal forces stiffen the
    disc, by the order of (Ω/ω)², which the eigenvalues leave out.
    """
    checked = scene(tmp_path)
    modal = modes(checked, comm=MPI.COMM_SELF, held="cap", top=9e3).modes
    run(checked, tmp_path / "run")
    samples = read(tmp_path / "run")
    assert samples is not None
    names = [f"edge_{k}" for k in range(PROBES)]
    seen = rim(samples, names, np.array([0.0, SPIN, 0.0]), np.zeros(3))
    for c, n, m in WANTED:
        mode = next(
            x for x in modal if (x.kind, x.diameters, x.circles) == (KINDS[c], n, m) and x.partner
        )
        q, f, whole = seen.order(n)[:, c], mode.frequency, n * SPIN / (2 * np.pi)
        apart = mode.carried * SPIN / (2 * np.pi)
        low, high = (abs(line(q, seen.t, sign * f, 1.5 * whole)) for sign in (1, -1))
        assert (high - low) / 2 == pytest.approx(apart, rel=1e-3), (c, n, m)
        assert 0 < (high + low) / 2 / f - 1 < 0.013, (c, n, m)
        if c == 0:
            assert apart == pytest.approx(whole, rel=0.015)
        else:
            assert apart < 0.9 * whole
    still = seen.at(0.3)[:, 0]  # at a place of the track: both lines of n = 3, m = 0
    f, apart = next((x.frequency, x.carried) for x in modal if (x.diameters, x.circles) == (3, 0))
    for way in (-1, 1):
        wanted = f + way * apart * SPIN / (2 * np.pi)
        assert line(still, samples.t, wanted, 30.0) == pytest.approx(wanted, rel=0.02)


@pytest.mark.parametrize("n", [2, 3, 5])
def test_coriolis_forces_on_a_thin_ring(n):
    """Bending in its plane, radial ``cos nθ``, circumferential ``-sin nθ / n``: n - 2 n / (n² + 1).

    Bryan's ringing wine glass (1890), 0.6 of n for n = 2; the same ring along its axle: n.
    """
    angle = 2 * np.pi * np.arange(64) / 64
    points = np.column_stack([np.sin(angle), 0 * angle, -np.cos(angle)])  # from the lowest point
    ahead = np.column_stack([np.cos(angle), 0 * angle, np.sin(angle)])
    bent = np.cos(n * angle)[:, None] * points - np.sin(n * angle)[:, None] / n * ahead
    along = np.cos(n * angle)[:, None] * np.array([0.0, 1.0, 0.0])
    axle = (np.zeros(3), np.array([0.0, 1.0, 0.0]))
    shapes, f = np.array([bent, along]), np.array([100.0, 200.0])
    (ring, axial), _ = labelled(f, shapes, points, np.ones(64), axle)
    assert ring.carried == pytest.approx(n - 2 * n / (n**2 + 1), rel=1e-9)
    assert axial.carried == pytest.approx(n, rel=1e-9)


def test_a_place_of_the_track_sees_the_wave_that_passes():
    """A standing wave cos 3θ cos ωt of a body at 50 rad/s, at an angle of the track."""
    t, theta = np.linspace(0, 0.1, 400), 2 * np.pi * np.arange(8) / 8
    wave = np.cos(3 * theta) * np.cos(900 * t)[:, None]
    seen = Rim(t, np.fft.fft(wave[:, :, None] * np.ones(3), axis=1) / 8, 50.0)
    expected = np.cos(3 * (0.4 - 50 * t)) * np.cos(900 * t)
    np.testing.assert_allclose(seen.at(0.4)[:, 0], expected, atol=1e-12)
    both = seen.order(3) + seen.order(-3)
    np.testing.assert_allclose(both[:, 1].real, np.cos(150 * t) * np.cos(900 * t), atol=1e-12)


def test_probes_that_are_not_round_the_rim(tmp_path):
    """Uneven probes, and displacements, are refused."""
    checked = scene(tmp_path, end=1e-4)
    run(checked, tmp_path / "run")
    samples = read(tmp_path / "run")
    assert samples is not None
    spin, centre = np.array([0.0, SPIN, 0.0]), np.zeros(3)
    with pytest.raises(ValueError, match="expected 3 evenly round the rim"):
        rim(samples, ["edge_0", "edge_1", "edge_2"], spin, centre)
    samples.quantity["edge_0"] = "displacement"
    with pytest.raises(ValueError, match="quantity = 'velocity'"):
        rim(samples, ["edge_0", "edge_8"], spin, centre)
