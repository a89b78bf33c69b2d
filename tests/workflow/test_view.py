# SPDX-License-Identifier: LGPL-3.0-or-later
"""A view of a run: bodies where they are, deformations to scale, a picture for each output."""

import json

import numpy as np
import pytest

pytest.importorskip("pyvista")

from workflow.figures.view import View, carried
from workflow.results.record import whole

HERTZ = {"time.end": 1e-6, "time.output_interval": 5e-7}


def test_rigid_motion_is_found():
    """A cube turned by 1000 degrees and carried away: nothing is left to enlarge."""
    rng = np.random.default_rng(1)
    X = rng.random((50, 3))
    a = np.radians(1000)
    R = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    x = X @ R.T + [3.0, 0.2, -1.0]
    assert np.abs(carried(X, x) - x).max() < 1e-12
    stretched = X * [1.01, 1, 1]
    assert 1e-3 < np.abs(carried(X, stretched) - stretched).max() < 1e-2


def test_scale_is_of_the_deformation(run_scene):
    """Twice the scale draws each body twice as far from its nearest rigid motion."""
    record = whole(run_scene("hertz", **HERTZ))
    plain, twice = (View(record, "displacement", scale, False) for scale in (1.0, 2.0))
    k = len(plain.times) - 1
    x, y = plain.at(k)[0], twice.at(k)[0]
    X = plain.body.points
    for nodes in plain.parts.values():
        rigid = carried(X[nodes], x[nodes])
        assert np.abs(x[nodes] - rigid).max() > 1e-7  # the bodies do deform
        assert np.allclose(y[nodes] - rigid, 2 * (x[nodes] - rigid), rtol=0, atol=1e-15)


def test_footprint_is_drawn_on_the_target(run_scene):
    """Close: one footprint, within its lift of the flat, under a ball that is looked through."""
    record = whole(run_scene("hertz", **HERTZ))
    view = View(record, "velocity", 1.0, True)
    assert view.glass == ["sphere"]
    x, _ = view.at(1)
    ((foot, points),) = view.feet_at(1, x)
    assert foot.side == "target"
    size = np.ptp(foot.position, axis=0).max()
    above = (points - x[foot.node])[foot.nodal["pressure"] > 0]
    assert np.allclose(np.linalg.norm(above, axis=1), 2e-3 * size, rtol=1e-6)
    assert (above[:, 2] > 0).all()


def test_pictures(run_scene, command, tmp_path):
    """A picture for each output, none of one colour; no display and a wrong quantity end with 2."""
    folder = run_scene("hertz", **HERTZ)
    found = json.loads(command("view", folder, "--pictures", tmp_path / "p", "--json").stdout)
    assert len(found["pictures"]) == 3
    import pyvista

    for path in found["pictures"]:
        pixels = np.asarray(pyvista.read(path)["PNGImage"])
        assert len(np.unique(pixels, axis=0)) > 100
    done = command("view", folder, "--quantity", "colour", check=False)
    assert done.returncode == 2
    assert "displacement, velocity" in done.stderr


def test_no_display(run_scene, command, monkeypatch):
    """Without a display a window is refused, and pictures are named."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    done = command("view", run_scene("hertz", **HERTZ), check=False)
    assert done.returncode == 2
    assert "--pictures" in done.stderr
