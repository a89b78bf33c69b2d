# SPDX-License-Identifier: LGPL-3.0-or-later
"""The main scene without statics: the wheelset rolls and lands on the rail at 3 m/s, every step."""

from mpi4py import MPI

import numpy as np
import pytest

from forms.loads import CarriedMass
from workflow import Scene, run
from workflow.model.model import Model
from workflow.results.record import Record

GRAVITY = 9.81

LANDING = {
    "equilibrium": None,
    "bodies.wheelset.velocity": [0.0, 0.0, -3.0],
    "time.end": 45e-6,
    "time.output_interval": 9e-6,
    "output.fields": False,
}


def vertical(model: Model) -> tuple[float, ...]:
    """Vertical momentum at t − dt/2, and the forces on the wheelset.

    Those of contact and suspension, the weight, and what carries the added mass along.
    """
    pair, state, dofs = model.pairs["wheel_rail"], model.state, model.bodies.dofs("wheelset")
    m = model.mass.array[::3][dofs]
    assert model.connections is not None
    spring = model.connections.links[-1]
    masses = model.connections.masses
    stretch = spring.stretch(state.u.x.array, masses.u)
    rate = spring.stretch(state.v.x.array, masses.v)
    (item,) = [item for item in model.items if isinstance(item, CarriedMass)]
    centre = item.centre + state.t * item.velocity
    r = item.reference + state.u.x.array.reshape(-1, 3)[item.dofs] - centre
    carried = item.mass @ np.cross(item.spin, np.cross(item.spin, r))
    return (
        float(m @ state.v.x.array.reshape(-1, 3)[dofs, 2]),
        float(pair.normal_resultant[2] + pair.tangential_force[2]),
        float(-(spring.stiffness * stretch + spring.damping * rate)[0, 2]),
        float(-GRAVITY * (m.sum() - model.added_mass.bodies["wheelset"])),
        float(carried[2]),
    )


@pytest.mark.slow
@pytest.mark.mpi
def test_landing_momentum_and_ranks(squealx, tmp_path):
    """The impulse of all forces on the wheelset is the change of momentum, to 1e-6 each step.

    The same 200 steps on two ranks give the same history to 1e-9 (row 23): forces over the largest
    contact force, energies over what is exchanged, so the 180 kJ of the ride to 1e-9 of itself.
    """
    rows: list = []
    scene = Scene.load("flange-transition", **LANDING)
    result = run(scene, tmp_path / "one", watch=lambda m: rows.append(vertical(m)), quiet=True)
    momentum, contact, suspension, weight, carried = np.array(rows).T
    assert result.summary["steps"] >= 200 and contact[-1] > 20e3
    impulse = result.summary["dt"] * np.cumsum(contact + suspension + weight + carried)[:-1]
    scale = result.summary["dt"] * contact.sum()
    np.testing.assert_allclose(momentum[1:] - momentum[0], impulse, rtol=0, atol=1e-6 * scale)
    every = result.summary["steps"] // (len(result.history["t"]) - 1)
    for name, column in (("contact_on_wheelset", contact), ("connection_suspension", suspension)):
        kept, seen = result.history[f"{name}_z_force"][1:], column[every::every]
        np.testing.assert_allclose(kept, seen, rtol=0, atol=1e-12 * contact.max())

    source = tmp_path / "one" / "scene.toml"
    squealx("run", source, "--ranks", 2, "--out", tmp_path / "two")
    one, two = result.history, Record(tmp_path / "two").history
    force, energy = one["wheel_rail_normal_force"].max(), one["internal"].max()
    ride = one["kinetic"].max()
    scales = {"kinetic": ride, "balance_error": ride / energy, "t": 45e-6}
    scales |= {"guarded_error": ride / one["contact_work"].max()}
    scales |= {"wheel_rail_patches": 1.0, "wheel_rail_max_penetration": 1e-5}
    scales |= {"wheel_rail_area": one["wheel_rail_area"].max()}
    assert one.keys() == two.keys() and MPI.COMM_WORLD.size == 1
    for name, column in one.items():
        scale = scales.get(name, force if name.endswith("force") else energy)
        np.testing.assert_allclose(two[name], column, rtol=0, atol=1e-9 * scale, err_msg=name)
