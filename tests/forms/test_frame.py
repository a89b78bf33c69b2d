# SPDX-License-Identifier: LGPL-3.0-or-later
"""Frames that turn with bodies: single precision after any rotation, and a run in them."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem, la
from scipy.spatial.transform import Rotation

from forms import elements
from forms.elasticity import Elastic, full
from forms.elements import LAWS
from forms.frame import TurningFrames
from forms.kernel import CellKernel
from meshes.domain import distribute
from meshes.shapes.blocks import block, distorted
from workflow.model.bodies import InternalForce
from workflow.model.state import State

STEEL = Elastic(210e9, 0.3, 7800.0, damping=1e-8)


def cube(n: int):
    """Return a distorted cube of n³ cells, spread over one rank."""
    mesh = distorted(block((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), cells=(n, n, n)))
    return distribute(mesh, MPI.COMM_SELF)


def body(angle: float, element: str, damped: bool):
    """Return the errors of float32 forces, in a frame and without, of a strained, turned block.

    Relative to the largest force, which strains of 1e-4 give.
    """
    domain = cube(4)
    V, dx = domain.V, full(domain.msh)
    x = V.tabulate_dof_coordinates()
    turn = Rotation.from_rotvec(angle * np.array([1.0, 2.0, 2.0]) / 3).as_matrix()
    strained = x + 1e-4 * np.sin(3 * x[:, [1, 2, 0]])
    state = State(fem.Function(V), fem.Function(V), la.vector(V.dofmap.index_map, 3))
    state.u.x.array[:] = (strained @ turn.T + [0.3, 0.0, 5.0] - x).ravel()
    state.v.x.array[:] = np.cross([0.0, 50.0, 0.0], strained @ turn.T).ravel()
    w, law = ufl.TestFunction(V), LAWS["total-lagrangian"]

    def work(u, v):
        return -elements.internal_work(element, law, u, w, STEEL, dx, v if damped else None)

    def force(form, precision, frames=None):
        item = InternalForce(form, V, precision, damped=False, stored={}, frames=frames)
        state.a.array[:] = 0.0
        item.add(state, state.a)
        return state.a.array.copy()

    exact = force(work(state.u, state.v), "float64")
    frames = TurningFrames(V, [np.arange(len(x), dtype=np.int32)], velocity=damped)
    found = force(work(frames.relative, frames.velocity), "float32", frames)
    plain = force(work(state.u, state.v), "float32")
    assert np.abs(frames.turn[1] - turn).max() < 1e-3
    size = np.abs(exact).max()
    return np.abs(found - exact).max() / size, np.abs(plain - exact).max() / size


@pytest.mark.parametrize("element", ["full", "one-point"])
@pytest.mark.parametrize("damped", [False, True], ids=["elastic", "damped"])
def test_single_precision_is_kept_after_any_rotation(element, damped):
    """Within 2e-6 of the largest force at 0, 0.4 and 2.5 rad; a thousandth without the frame."""
    for angle in (0.0, 0.4, 2.5):
        framed, plain = body(angle, element, damped)
        assert 1e-9 < framed < 2e-6
        if angle > 0.1:
            assert plain > 50 * framed


def test_frames_only_turn_what_turns():
    """Two blocks of nodes: that without a frame keeps its displacement to the last bit."""
    domain = cube(3)
    x = domain.V.tabulate_dof_coordinates()
    half = np.flatnonzero(x[:, 0] > np.median(x[:, 0])).astype(np.int32)
    frames = TurningFrames(domain.V, [half])
    u = np.zeros_like(x)
    turn = Rotation.from_rotvec([0.0, 0.0, 0.7]).as_matrix()
    u[half] = x[half] @ turn.T - x[half]
    u += 0.1
    frames.follow(u.ravel())
    frames.enter(u.ravel(), u.ravel())
    relative = frames.relative.x.array.reshape(-1, 3)
    rest = np.setdiff1d(np.arange(len(x)), half)
    assert (relative[rest] == u[rest]).all()
    assert np.ptp(relative[half], axis=0).max() < 1e-14  # a rigid motion is a shift in the frame
    frames.force[:] = 1.0
    out = np.zeros(u.size)
    frames.release(out)
    np.testing.assert_allclose(out.reshape(-1, 3)[half], np.ones((len(half), 3)) @ turn.T)
    assert (out.reshape(-1, 3)[rest] == 1.0).all() and not frames.force.any()


def test_kernel_takes_single_precision():
    """The kernel of the test above is one that computes in float32, not DOLFINx's assembly."""
    domain = cube(2)
    frames = TurningFrames(domain.V, [])
    form = elements.internal_work(
        "full", LAWS["total-lagrangian"], frames.relative, ufl.TestFunction(domain.V), STEEL,
        full(domain.msh)
    )  # fmt: skip
    assert CellKernel(form, "float32").engine.reason is None


def test_rotations_are_kept_for_other_ranks():
    """On as many ranks each has its own; else every body has that of the rank that saw it turn."""
    domain = cube(2)
    bodies = [np.arange(4, dtype=np.int32), np.arange(5, 9, dtype=np.int32)]
    frames = TurningFrames(domain.V, bodies)
    turn = Rotation.from_rotvec([0.0, 0.3, 0.0]).as_matrix()
    frames.turn[1] = turn
    own = frames.memory(MPI.COMM_SELF)
    frames.turn[:] = np.eye(3)
    frames.restore(MPI.COMM_SELF, own)
    np.testing.assert_array_equal(frames.turn[1], turn)
    other = np.tile(np.eye(3), (2, 3, 1, 1))
    other[1, 2] = turn  # seen by the second of two ranks
    frames.restore(MPI.COMM_SELF, other)
    np.testing.assert_array_equal(frames.turn[2], turn)
    np.testing.assert_array_equal(frames.turn[1], np.eye(3))
