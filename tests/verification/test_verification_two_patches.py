# SPDX-License-Identifier: LGPL-3.0-or-later
"""Verification of two patches at rest: row 25, rail top and gauge corner at once.

The half-spaces that the patches are compared with are checked with somebody else's code.
"""

import numpy as np
import pytest

from contact.theory.closed_forms import contact_modulus
from contact.theory.wheel_on_rail import gap, profile_contact
from meshes.profiles.placement import RADIUS, lateral_shift_for, rail_in_track
from meshes.profiles.profiles import s1002
from meshes.profiles.surfaces import rail_surface, wheel_surface
from workflow import Scene, run

YAW = 0.02
MODULUS = contact_modulus(210e9, 0.3, 210e9, 0.3)


def half_spaces(place: str, load: float):
    """Gap between the drawn profiles at a patch, its spacing, and the contact there."""
    at = lateral_shift_for(flange_gap=0.0, yaw=YAW)
    wheel = wheel_surface(s1002(), RADIUS, at.centre, YAW)
    rail = rail_surface(rail_in_track())
    near = {"rail top": at.tread_point, "gauge corner": at.flange_point}[place]
    found = profile_contact(wheel, rail, near, load, MODULUS, (0.02, 0.004))
    distance = gap(wheel, rail, found.origin, found.frame, found.grid)
    return distance.reshape(len(found.x), len(found.y)), found.half_space


@pytest.mark.parametrize(
    ("place", "load"), [("rail top", 3e4), ("gauge corner", 1e4), ("gauge corner", 4e4)]
)
def test_half_spaces_against_tamaas(place, load):
    """The same gap by tamaas, not periodic: pressures to 0.2 % of the largest, force to 1e-6.

    tamaas: L. Frerot, G. Anciaux, V. Rey, S. Pham-Ba, J.-F. Molinari, JOSS 5 (2020) 2121.
    """
    tamaas = pytest.importorskip("tamaas")
    distance, own = half_spaces(place, load)
    (n, m), (dx, dy) = distance.shape, own.spacing
    tamaas.initialize(1)
    model = tamaas.ModelFactory.createModel(tamaas.model_type.basic_2d, [n * dx, m * dy], [n, m])
    model.E, model.nu = MODULUS, 0.0  # a rigid surface on half-spaces of the contact modulus
    tamaas.ModelFactory.registerNonPeriodic(model, "dcfft")
    solver = tamaas.PolonskyKeerRey(model, -(distance - distance.min()), 1e-12)
    solver.setIntegralOperator("dcfft")
    solver.solve(load / (n * dx * m * dy))
    other = np.array(model.traction)
    assert other.sum() * dx * dy == pytest.approx(load, rel=1e-6)
    assert np.abs(own.pressure - other).max() < 2e-3 * other.max()
    assert own.area == pytest.approx(float((other > 0).sum()) * dx * dy, rel=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("strip", "area", "peak"),
    [(5e-4, 0.15, 0.15), pytest.param(2e-4, 0.05, 0.10, marks=pytest.mark.long)],
)
def test_row_25_two_patches_at_rest(tmp_path, strip, area, peak):
    """Area and peak pressure of both patches, 50 kN each, against half-spaces, by cells across."""
    scene = Scene.load("two-patches", **{"mesh.strip.size": strip})
    found = {a["quantity"]: a for a in run(scene, tmp_path / "run", quiet=True).summary["expected"]}
    for place in (1, 2):
        assert abs(found[f"patch {place} at rest: area"]["error"]) < area
        assert abs(found[f"patch {place} at rest: peak pressure"]["error"]) < peak
