# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact at points in the contactor's facets: shares, uniform pressure, drawn shape, tangent."""

import numpy as np
import pytest

from contact import ContactPair, rigid_plane
from contact.stack import points_in
from contact.surface import tributary_area
from tests.skins import evaluate, plate_on_plane, skin, stacked, state_of, tangent_of, two_skins
from workflow import Scene
from workflow.scene.scene import SceneError


def test_points_share_area_and_mass_of_the_nodes():
    """Warped, uneven facets: the areas of the points, spread by their weights, are the nodes'."""
    _, upper = two_skins()
    points = points_in(upper, 0.7)
    area = np.bincount(points.node.ravel(), (points.weight * points.area[:, None]).ravel())
    assert area == pytest.approx(tributary_area(upper), rel=1e-12)
    assert points.mass.sum() == pytest.approx(upper.mass.sum(), rel=1e-12)


@pytest.mark.parametrize("friction", [False, True])
def test_uniform_overlap_loads_nodes_by_their_areas(friction):
    """A plate 1 µm deep in a plane: the force on each node over its area is the same to 1e-12.

    The pressure is that of springs at the nodes: stiffness per area does not depend on the points.
    """
    plate, pair, state = plate_on_plane(0.3, points="quadrature")
    _, nodal, _ = plate_on_plane(0.3)
    force, other = (evaluate(p, state, friction=friction) for p in (pair, nodal))
    pressure = force[:, 2] / tributary_area(plate)
    assert pressure == pytest.approx(np.full(25, pressure[0]), rel=1e-12)
    assert force == pytest.approx(other, rel=1e-9, abs=1e-9 * np.abs(other).max())
    foot = pair.footprint()
    assert len(foot.node) == 25 and foot.pressure == pytest.approx(pressure, rel=1e-12)
    nodes, sampled = pair.passes[0].forces()
    assert (plate.nodes[nodes] == foot.node).all()
    assert sampled[:, :3].sum(axis=0) == pytest.approx(pair.normal_resultant, rel=1e-12)


def test_points_stand_over_their_facets_where_the_drawn_surface_does():
    """A cylinder of 13 mm in chords of 2 mm over a plane: gaps to 3 % of the sagitta.

    Facets that count as flat leave points off by two thirds of it.
    """
    R, h, m = 13e-3, 2e-3, 9
    angle = np.linspace(-m * h / R / 2, m * h / R / 2, m + 1)
    grid = skin(m, 4, 1.0, 4 * h, lambda x, y: 0 * x, up=False)
    place = grid.reference.reshape(m + 1, 5, 3)
    place[:, :, 0], place[:, :, 2] = R * np.sin(angle)[:, None], -R * np.cos(angle)[:, None]
    plane = rigid_plane((0, 0, -R - 1e-5), (0, 0, 1), 1.0)
    state = state_of(np.zeros(3 * 5 * (m + 1)), np.zeros(3 * 5 * (m + 1)))

    def error(sharp_angle):
        options = {"points": "quadrature", "sharp_angle": sharp_angle, "reach": 1e-2}
        pair = ContactPair(grid, plane, dt=1e-6, **options)
        pair.passes[0].candidates.margin = 1e-2
        evaluate(pair, state)
        side = pair.passes[0]
        c = side.candidates.item
        x = side.stack.reference[c, 0]
        inner = np.abs(x) < 0.3 * R
        exact = R + 1e-5 - np.sqrt(R**2 - x**2)
        return np.abs(side.contact_state.gap[c] - exact)[inner].max()

    sagitta = h**2 / (8 * R)
    assert error(1e-6) == pytest.approx(2 / 3 * sagitta, rel=0.15)
    assert error(0.7) < 0.03 * sagitta


def test_tangent():
    """Statics: the derivative of the force is minus the tangent but for the turning of normals."""
    lower, upper = two_skins()
    pair = ContactPair(upper, lower, dt=1e-6, points="quadrature")
    X, state = stacked(lower, upper)
    u = state.u.x.array.reshape(-1, 3)
    u[len(lower.nodes) :, 2] = -6e-4
    f = evaluate(pair, state, friction=False)
    assert pair.active > 20
    K = tangent_of(pair, state, lower, upper)
    step = 1e-10 * np.random.default_rng(0).normal(size=X.shape)
    u += step
    g = evaluate(pair, state, friction=False)
    off = np.linalg.norm((g - f).ravel() + K @ step.ravel()) / np.linalg.norm(g - f)
    assert off < 0.1


@pytest.mark.parametrize("change", [{"two_pass": True}, {"method": "lagrange"}], ids=str)
def test_what_points_do_not_go_with(change):
    lower, upper = two_skins()
    with pytest.raises(ValueError, match="points = 'quadrature': expected"):
        ContactPair(upper, lower, dt=1e-6, points="quadrature", **change)
    plane = rigid_plane((0, 0, 0), (0, 0, 1), 1.0)
    with pytest.raises(ValueError, match="a deformable contactor"):
        ContactPair(plane, lower, dt=1e-6, points="quadrature")
    keys = {f"contacts.face.{key}": value for key, value in change.items()}
    with pytest.raises(SceneError, match="points = 'quadrature': expected method"):
        Scene.load("sliding-block", **keys, **{"contacts.face.points": "quadrature"})
