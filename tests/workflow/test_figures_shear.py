# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the figures of shear show: which outputs, which row of nodes, which sense of the angle."""

import numpy as np
import pytest

from workflow.figures.shear import centre_row, moments
from workflow.results.patch_nodes import PatchNodes, patches_of
from workflow.results.record import Contact


def patch(nodes, *, shear=(0.0, 0.0), normal=(0.0, 0.0, 1.0), at=(0.0, 0.0, 0.0), size=2e-3):
    """A patch of columns x rows of nodes; ``shear`` acts on the upper body, along x and y [Pa]."""
    grid = size * np.mgrid[: nodes[0], : nodes[1]].reshape(2, -1).T
    grid = grid - grid.mean(axis=0)
    position = np.column_stack([grid, np.zeros(len(grid))]) + at
    one = np.ones(len(grid))
    traction = np.tile([*shear, 0.0], (len(grid), 1)) * size**2
    return PatchNodes(position, np.tile(normal, (len(grid), 1)), 1e9 * size**2 * one, traction,
                 size**2 * one, 0.5 * one, one > 0)  # fmt: skip


def test_moments_before_and_through_the_transition():
    """Two outputs with one patch, first, middle and last with two; crumbs do not count."""
    top, corner, crumb = patch((5, 3)), patch((4, 2)), patch((1, 1))
    outputs = [{1: top}] * 4 + [{1: top, 2: crumb}] + [{1: top, 2: corner}] * 5
    outputs += [{1: crumb, 2: corner}] * 3
    contact = Contact(np.arange(len(outputs)) * 1.0, outputs)
    assert [t for t, _ in moments(contact)] == [2.0, 4.0, 5.0, 7.0, 9.0]
    assert [sorted(p) for _, p in moments(contact)] == [[1]] * 2 + [[1, 2]] * 3
    alone = Contact(np.arange(9.0), [{1: top}] * 9)
    assert [t for t, _ in moments(alone)] == [1.0, 3.0, 6.0, 8.0]  # Python rounds half to even
    assert [t for t, _ in moments(Contact(np.arange(1.0), [{1: top}]))] == [0.0]
    assert moments(Contact(np.arange(2.0), [{}, {}])) == []


@pytest.mark.parametrize("rows", [1, 2, 3, 4])
def test_centre_row_is_next_to_the_centre(rows):
    one = patch((6, rows))
    row = centre_row(one)
    x, y = one.local[row].T
    assert len(row) == 6 and (np.diff(x) > 0).all()
    assert np.ptp(y) < 1e-12 and abs(y[0]) <= 1e-3 * (1 + 1e-9)


def test_centre_row_has_one_node_a_column():
    """Rows that end half way and lie closer than the nodes along them: no way back and forth."""
    one = patch((8, 1))
    other = patch((3, 1), at=(-5e-3, 0.8e-3, 0.0))
    both = PatchNodes(*(np.concatenate([getattr(p, k) for p in (one, other)]) for k in vars(one)))
    x = both.local[centre_row(both), 0]
    assert len(x) == 8 and (np.diff(x) > 1e-3).all()


@pytest.mark.parametrize("angle", [0.0, 30.0, 70.0, -40.0, 120.0])
def test_angle_is_that_of_the_shear_on_the_lower_body(angle):
    """The wheel is pushed forward and to the field side, the rail back and to the gauge side."""
    a = np.radians(angle)
    one = patch((4, 3), shear=(2e8 * np.cos(a), 2e8 * np.sin(a)))
    assert one.shear_angle == pytest.approx(a)
    assert one.mean_shear == pytest.approx(2e8)
    assert one.longitudinal_shear == pytest.approx(-2e8 * np.cos(a), abs=1)
    assert one.lateral_shear == pytest.approx(-2e8 * np.sin(a), abs=1)
    assert np.isnan(patch((4, 3), shear=(1e5, 0.0)).shear_angle)


def test_angle_does_not_depend_on_which_body_has_the_contactor_nodes():
    one = patch((4, 3), shear=(1e8, 2e8))
    arrays = {
        "position": one.position,
        "normal": one.normal,
        "normal_force": one.normal_forces,
        "tangential_force": one.tangential_forces,
        "area": one.areas,
        "patch": np.zeros(12, dtype=int),
        "stick": one.stick,
        "friction": one.friction,
    }
    other = arrays | {"normal": -one.normal, "tangential_force": -one.tangential_forces}
    for found in (patches_of(arrays)[1], patches_of(other)[1]):
        assert found.shear_angle == pytest.approx(one.shear_angle)
        np.testing.assert_allclose(found.shear, one.shear)
