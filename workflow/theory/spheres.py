# SPDX-License-Identifier: LGPL-3.0-or-later
"""Hollow sphere that yields under pressure from inside: onset, plastic front, collapse."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from forms.loads import smooth_step
from meshes.arrays import Array
from workflow.results.record import Record
from workflow.scene.bodies import ElastoPlastic
from workflow.scene.mesh import HollowSphereMesh
from workflow.scene.scene import Scene
from workflow.theory.assumptions import bare, held, undamped, yielding
from workflow.theory.quantity import HILL, Expected

NEAR, HALF = 0.05, 0.5  # of the wall, between which the front is followed back to the hole
ENOUGH = 10  # outputs there, at least
BEYOND = 1.2  # outer radii, where the front would be: all has yielded for long


@dataclass(frozen=True)
class Sphere:
    """A hollow sphere of perfectly plastic steel, its pressures over the yield stress.

    Attributes:
        ratio: Outer over inner radius b/a.
        dissipation: Unit of the plastic dissipation of an eighth, ``π/2 a³ Y · 2 (1 − ν) Y / E``,
            from the equivalent plastic strain ``2 (1 − ν) Y/E (c³/r³ − 1)`` below a front at c [J].
    """

    ratio: float
    dissipation: float

    def pressure(self, c: float) -> float:
        """Return the pressure that holds the front at c, in inner radii [-]."""
        return float(2 * np.log(c) + 2 / 3 * (1 - (c / self.ratio) ** 3))

    def front(self, dissipation: float) -> float:
        """Return where the front is that has dissipated so much [J], in inner radii [-]."""
        share = dissipation / self.dissipation
        if share <= 0:
            return 1.0
        most = float(np.cbrt(1 + 3 * share) + 1) * self.ratio
        return float(brentq(lambda c: c**3 * np.log(c) - (c**3 - 1) / 3 - share, 1.0, most))


def yielding_sphere(record: Record) -> Iterator[Expected]:
    """Answers for a hollow sphere whose pressure inside comes up slowly (Hill).

    The front follows from the plastic dissipation; the pressure that the wall resists from its
    work, without inertia. Onset is the resistance with the front followed back to the hole by a
    cubic.
    """
    sphere, history = hollow(record.checked), record.history
    if sphere is None or "plastic_dissipation" not in history:
        return
    c = np.array([sphere.front(D) for D in history["plastic_dissipation"]])
    resisted, way, c = _resistance(record, c)
    wall = sphere.ratio - 1
    on = (c > 1 + NEAR * wall) & (c < 1 + HALF * wall)
    if on.sum() >= ENOUGH:
        onset = float(np.polynomial.Polynomial.fit(c[on], resisted[on], 3)(1.0))
        yield Expected("pressure over Y, first yield", "1", onset, sphere.pressure(1.0), HILL)
    middle = 1 + wall / 2
    if c.max(initial=0.0) > middle:
        k = int(np.argmax(c > middle))
        there = float(np.interp(middle, c[k - 1 : k + 1], resisted[k - 1 : k + 1]))
        name = "pressure over Y, front in the middle of the wall"
        yield Expected(name, "1", there, sphere.pressure(middle), HILL)
    flows = c > BEYOND * sphere.ratio
    if flows.sum() >= ENOUGH:
        mean = float(resisted[flows] @ way[flows] / way[flows].sum())
        exact = 2 * float(np.log(sphere.ratio))
        yield Expected("pressure over Y, collapse", "1", mean, exact, HILL)


def hollow(scene: Scene) -> Sphere | None:
    """Return the sphere of a scene, None if it is another scene.

    Assumes an eighth held in its planes of symmetry, perfectly plastic, under pressure inside only.
    """
    mesh, steel = scene.mesh, yielding(scene, "sphere")
    if not isinstance(mesh, HollowSphereMesh) or steel is None or not _perfect(scene, steel):
        return None
    if not bare(scene) or not undamped(scene) or scene.contacts or scene.driven:
        return None
    if any(held(scene, f"{axis}min") != {axis} for axis in "xyz") or len(scene.supports) != 3:
        return None
    if len(scene.loads) != 1 or scene.loads[0].surface != "inside" or any(scene.loads[0].traction):
        return None
    if not scene.loads[0].ramp or scene.loads[0].pressure <= 0:
        return None
    a, Y = mesh.inner_radius, steel.yield_stress
    strain = 2 * (1 - steel.poisson_ratio) * Y / steel.youngs_modulus
    return Sphere(mesh.outer_radius / a, np.pi / 2 * a**3 * Y * strain)


def _perfect(scene: Scene, steel: ElastoPlastic) -> bool:
    """Whether all of a body yields, and without hardening."""
    hardens = (steel.hardening_modulus, steel.saturation_stress, steel.back_stresses)
    (body,) = scene.bodies.values()
    return not any(hardens) and body.yielding is None and not any(body.velocity or ())


def _resistance(record: Record, c: Array) -> tuple[Array, Array, Array]:
    """Return pressure over Y that the wall resists, volume swept, and front, between the outputs.

    The work of stress over the volume that the hole gains, which the work of the load tells.
    """
    history, (load,) = record.history, record.checked.loads
    steel = yielding(record.checked, "sphere")
    assert steel is not None
    applied = load.pressure * np.array([smooth_step(t / load.ramp) for t in history["t"]])
    middle = (applied[1:] + applied[:-1]) / 2
    work = history["internal"] + history["hourglass"] + history["plastic_dissipation"]
    volume = np.diff(history["external_work"]) / np.where(middle > 0, middle, np.inf)
    grows = volume > 0
    resisted = np.diff(work)[grows] / volume[grows] / steel.yield_stress
    return resisted, volume[grows], ((c[1:] + c[:-1]) / 2)[grows]
