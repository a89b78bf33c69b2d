# SPDX-License-Identifier: LGPL-3.0-or-later
"""Patch table of a result folder: a row for each patch and output, and the list of events."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from meshes.arrays import Array
from workflow.results.columns import Item, rows
from workflow.scene.scene import Scene

if TYPE_CHECKING:
    from contact.creepage import Creepage
    from contact.footprint import Footprint, Patch
    from contact.patches import Event

Cell = float | Array
CHUNK = 256  # rows of the table that are stored together


@dataclass(frozen=True)
class Column:
    """A column of the table.

    Attributes:
        unit: Its unit.
        value: Its value of a patch and its creepage.
        about: What it is, written beside it.
    """

    unit: str
    value: "Callable[[Patch, Creepage], Cell]"
    about: str


COLUMNS = {
    "nodes": Column("1", lambda p, c: p.nodes, "nodes in contact"),
    "sticking": Column("1", lambda p, c: p.sticking, "nodes that adhere"),
    "area": Column("m^2", lambda p, c: p.area, "sum of tributary areas"),
    "centre": Column("m", lambda p, c: p.centre, "mean position, weighted by normal force"),
    "normal": Column("1", lambda p, c: p.frame[2], "third axis of the patch: away from the target"),
    "longitudinal": Column("1", lambda p, c: p.frame[0], "first axis of the patch"),
    "contact_angle": Column("rad", lambda p, c: p.contact_angle, "of the normal to the vertical"),
    "normal_force": Column("N", lambda p, c: p.normal_force, "sum of nodal normal forces"),
    "max_pressure": Column("Pa", lambda p, c: p.max_pressure, "largest nodal pressure"),
    "force": Column("N", lambda p, c: p.force, "on the contactor, axes of the track"),
    "force_in_frame": Column("N", lambda p, c: p.force_in_frame, "the same, axes of the patch"),
    "spin_moment": Column("N m", lambda p, c: p.spin_moment, "of tangential forces, on the normal"),
    "shear_stress": Column("Pa", lambda p, c: p.shear_stress, "mean, longitudinal and lateral"),
    "mean_shear": Column("Pa", lambda p, c: p.mean_shear, "tangential force over area"),
    "shear_angle": Column("rad", lambda p, c: p.shear_angle, "of shear on the target, from -x"),
    "rigid_slip": Column("m/s", lambda p, c: c.slip, "of rigid bodies, longitudinal and lateral"),
    "spin_rate": Column("rad/s", lambda p, c: c.spin_rate, "of rigid bodies, about the normal"),
    "rolling_speed": Column("m/s", lambda p, c: c.speed, "of the contact on the surfaces"),
    "creepage": Column(
        "1", lambda p, c: np.array([c.longitudinal, c.lateral]), "rigid slip over rolling speed"
    ),
    "friction_power": Column("W", lambda p, c: p.friction_power, "of tangential forces on slip"),
    "t_gamma": Column("N", lambda p, c: t_gamma(p, c), "tangential force times creepage"),
    "spin_t_gamma": Column("N", lambda p, c: -p.spin_moment * c.spin, "spin moment times spin"),
    "spin_creepage": Column("1/m", lambda p, c: c.spin, "spin rate over rolling speed"),
}


def traction_coefficient(patch: "Patch") -> float:
    """Return the tangential over the normal force of a patch [-]."""
    return float(np.linalg.norm(patch.frame[:2] @ patch.tangential_force) / patch.normal_force)


def t_gamma(patch: "Patch", motion: "Creepage") -> float:
    """Return the tangential force times creepage [N], the wear number: heat per way rolled.

    Positive where the force on the contactor opposes its rigid slip. The part of spin is apart.
    """
    force = patch.frame[:2] @ patch.tangential_force
    return float(-force[0] * motion.longitudinal - force[1] * motion.lateral)


def travel(scene: Scene) -> Array | None:
    """Return the velocity at which contact travels, shape ``(3,)`` [m/s], None if it stays.

    It is that of the axle of the wheelset, or of the one driven body that spins.
    """
    if scene.rolling is not None:
        angle = scene.rolling.travel
        if not scene.rolling.speed:
            return None
        return scene.rolling.speed * np.array([np.cos(angle), np.sin(angle), 0.0])
    turning = [d for d in scene.driven.values() if any(d.spin)]
    return np.array(turning[0].velocity) if len(turning) == 1 else None


def creepages(
    contactor: Array, target: Array, footprint: "Footprint", scene: Scene
) -> "tuple[Creepage, ...]":
    """Return the creepage at each patch of a footprint.

    Args:
        contactor: Position and velocity of all contactor nodes, shape ``(n, 6)`` [m, m/s].
        target: Those of the target, shape ``(m, 6)`` [m, m/s].
        footprint: The footprint.
        scene: What tells how contact travels.
    """
    from contact.creepage import creepage_of

    way = travel(scene)
    return tuple(creepage_of(patch, contactor, target, way) for patch in footprint.patches)


def patch_rows(
    table: str,
    output: int,
    t: float,
    footprint: "Footprint",
    identity: npt.NDArray[np.int64],
    motion: "Sequence[Creepage]",
    k: float | None = None,
) -> Iterator[Item]:
    """Yield the columns of the table of an HDF5 file, a row for each patch.

    With ``k``, the yield stress in shear [Pa], those of steel too.
    """
    n = len(identity)
    yield rows(f"{table}/output", np.full(n, output), "1", "number of the output", CHUNK)
    yield rows(f"{table}/t", np.full(n, t), "s", "time", CHUNK)
    yield rows(f"{table}/patch", identity, "1", "identity of the patch", CHUNK)
    for name, column in COLUMNS.items() if n else ():
        pairs = zip(footprint.patches, motion, strict=True)
        values = np.array([column.value(p, c) for p, c in pairs], dtype=np.float64)
        yield rows(f"{table}/{name}", values, column.unit, column.about, CHUNK)
    if n and k is not None:
        pressure = np.array([patch.max_pressure / k for patch in footprint.patches])
        about = "largest pressure over the yield stress in shear of the weaker body"
        yield rows(f"{table}/pressure_over_k", pressure, "1", about, CHUNK)
        traction = np.array([traction_coefficient(patch) for patch in footprint.patches])
        about = "tangential over normal force"
        yield rows(f"{table}/traction_coefficient", traction, "1", about, CHUNK)


def event_rows(table: str, events: "Sequence[Event]") -> Iterator[Item]:
    """Yield the columns of the table of events of an HDF5 file."""
    about = "birth, end, split (broke off other) or merge (taken up by other)"
    columns = (
        ("t", [e.t for e in events], np.float64, "s", "time"),
        ("patch", [e.patch for e in events], np.int64, "1", "identity"),
        ("other", [e.other for e in events], np.int64, "1", "or -1"),
        ("kind", [e.kind for e in events], "S5", "", about),
    )
    for name, values, kind, unit, told in columns:
        yield rows(f"{table}/{name}", np.array(values, dtype=kind), unit, told, CHUNK)
