# SPDX-License-Identifier: LGPL-3.0-or-later
"""The figure of what has yielded."""

import numpy as np
import pytest

pytest.importorskip("matplotlib")
pytest.importorskip("pyvista")

from meshes.shapes.blocks import block
from workflow.figures.plastic import plastic_strain, skin, yielded
from workflow.results.record import Body, Record

SLOW = {"bodies.bar.velocity": [-10.0, 0.0, 0.0]}


def test_facets_of_a_skin_and_the_cells_behind():
    """Of 3 × 2 × 2 cells 32 facets, each one of its cell's own."""
    mesh = block((0, 0, 0), (3, 2, 2), cells=(3, 2, 2))
    facets, behind = skin(Body(mesh.points, mesh.cells, mesh.regions))
    assert len(facets) == 32
    assert all(
        set(quad) <= set(mesh.cells[cell]) for quad, cell in zip(facets, behind, strict=True)
    )
    assert set(behind) == set(range(12))


def test_what_has_yielded_is_drawn_and_what_has_not_is_not(run_scene):
    """A bar on a wall: most at the wall, six panels that cover it; below its yield none."""
    keys = {"mesh.size": 2.5e-3, "time.end": 1e-5}
    record = Record(run_scene("plastic-bar", **keys))
    zone = yielded(record)
    assert zone is not None and zone.worst[0] < 0.0025
    assert zone.strain.max() > 1e-3 and 5e8 < zone.stress.max() < 8e8
    assert zone.lower[0] < 0 < zone.upper[0] < 0.1
    fig = plastic_strain(record)
    assert fig is not None
    values = [panel.collections[0].get_array() for panel in fig.axes[:6]]
    np.testing.assert_allclose(values[0].max(), 100 * zone.strain.max(), rtol=1e-6)
    assert [len(v) for v in values[2:6:3]] == [4, 4]  # the face on the wall
    assert plastic_strain(Record(run_scene("plastic-bar", **keys, **SLOW))) is None
    assert plastic_strain(Record(run_scene("bar-wave", **{"mesh.size": 5e-3}))) is None
