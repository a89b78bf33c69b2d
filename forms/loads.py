# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads that are not springs: dead loads, drive torque, damping by mass, carried mass."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
import ufl

from forms.nodal import lib, pointer, struct
from forms.rank_sums import gathered, own_part
from meshes.arrays import Array, Dofs, Index
from meshes.quads import gauss_points, nodal_areas


def gravity(w: Any, rho: float, g: Sequence[float]) -> Any:
    """Virtual work of the weight, ``ρ g · w``, with the acceleration of gravity ``g`` [m/s²]."""
    return rho * ufl.inner(ufl.as_vector(list(g)), w)


def nodal_traction(points: Array, quads: Index, traction: Array) -> Array:
    """Return the nodal forces of a dead traction on bilinear quads, shape ``(n, 3)`` [N].

    Args:
        points: Node positions, shape ``(n, 3)`` [m].
        quads: Nodes of each quad, shape ``(q, 4)``.
        traction: Force per reference area, shape ``(3,)`` [Pa].
    """
    return nodal_areas(points, quads)[:, None] * np.asarray(traction)


def nodal_pressure(points: Array, quads: Index, pressure: float) -> Array:
    """Return the nodal forces of a pressure on bilinear quads, shape ``(n, 3)`` [N].

    Args:
        points: Node positions, shape ``(n, 3)`` [m].
        quads: Nodes of each quad, counter-clockwise from outside, shape ``(q, 4)``.
        pressure: Pushes inwards [Pa].
    """
    force = np.zeros_like(points)
    for N, vector in gauss_points(points[quads]):
        np.add.at(force, quads, -pressure * N[:, None] * vector[:, None])
    return force


def smooth_step(s: float) -> float:
    """Return the quintic from 0 to 1 within 0 ≤ s ≤ 1, at rest up to the second derivative."""
    s = min(max(s, 0.0), 1.0)
    return s**3 * (10 - 15 * s + 6 * s**2)


@dataclass
class DeadLoad:
    """A constant nodal force: gravity, traction.

    Attributes:
        nodal: Force on every owned dof, shape ``(3 * owned,)`` [N].
    """

    comm: MPI.Comm
    nodal: Array

    def add(self, state: Any, force: Any) -> None:
        """Add the load."""
        force.array[: len(self.nodal)] += self.nodal

    def energy(self, state: Any) -> dict[str, float]:
        """Return the work done since the undeformed state [J]; collective."""
        u = state.u.x.array[: len(self.nodal)]
        return {"external_work": float(self.comm.allreduce(self.nodal @ u))}


def pulse(s: float) -> float:
    """Return ``sin²(π s)`` within 0 ≤ s ≤ 1, zero outside: a blow of a hammer."""
    return float(np.sin(np.pi * s) ** 2) if 0.0 < s < 1.0 else 0.0


def pulse_spectrum(frequency: Array, duration: float) -> npt.NDArray[np.complex128]:
    """Return ``∫ pulse(t / T) exp(-i ω t) dt`` [s].

    It is ``T / 2 sin(x) / (x (1 - (x / π)²)) exp(-i x)`` with ``x = ω T / 2``.

    Args:
        frequency: Shape ``(m,)`` [Hz].
        duration: T [s].
    """
    y = np.asarray(frequency) * duration  # x / π
    with np.errstate(divide="ignore", invalid="ignore"):
        size = np.where(np.abs(y * y - 1) < 1e-9, 0.5, np.sinc(y) / (1 - y * y))
    return np.asarray(duration / 2 * size * np.exp(-1j * np.pi * y))


@dataclass
class TimedLoad:
    """A nodal force that is there for a time or comes up smoothly; there is none at rest.

    Attributes:
        nodal: Force on every owned dof at its largest, shape ``(3 * owned,)`` [N].
        time: Time in which it comes up, or a blow lasts [s].
        course: Its part of the largest over time as a part of ``time``.
    """

    rest: ClassVar = None

    comm: MPI.Comm
    nodal: Array
    time: float
    course: Callable[[float], float] = smooth_step
    work: float = 0.0
    _last: tuple[float, float] | None = field(default=None, repr=False)  # share, work of all of it

    def add(self, state: Any, force: Any) -> None:
        """Add the load of the time and collect its work (trapezoidal in displacement)."""
        share, whole = self.course(state.t / self.time), 0.0
        before, then = self._last or (share, None)
        if share > 0.0:
            force.array[: len(self.nodal)] += share * self.nodal
        if share > 0.0 or before > 0.0:
            whole = float(self.nodal @ state.u.x.array[: len(self.nodal)])
        if then is not None:
            self.work += (before + share) / 2 * (whole - then)
        self._last = share, whole

    def energy(self, state: Any) -> dict[str, float]:
        """Return the work done so far [J]; collective."""
        return {"external_work": self.comm.allreduce(self.work)}

    def memory(self) -> dict[str, Array]:
        """Return the work done on each rank; collective."""
        return {"work": gathered(self.comm, self.work)}

    def restore(self, memory: Mapping[str, Array]) -> None:
        """Go on from what :meth:`memory` returned."""
        self.work = own_part(self.comm, memory["work"])


@dataclass
class MassDamping:
    """Rayleigh damping in proportion to mass, ``−α m v``.

    Attributes:
        nodal: ``α m`` of every owned dof, shape ``(3 * owned,)`` [N s/m].
        dt: Step, for the energy taken [s].
    """

    rest: ClassVar = None

    comm: MPI.Comm
    nodal: Array
    dt: float
    dissipation: float = 0.0
    _last: Array = field(init=False, repr=False)
    _force: Array = field(init=False, repr=False)
    _began: bool = field(default=False, repr=False)

    def __post_init__(self) -> None:
        self._last, self._force = np.empty_like(self.nodal), np.empty_like(self.nodal)

    def add(self, state: Any, force: Any) -> None:
        """Add the damping force and collect its work (trapezoidal, over the way ``dt v``)."""
        v, f, total = state.v.x.array[: len(self.nodal)], self._force, self._last
        np.multiply(self.nodal, v, out=f)
        force.array[: len(f)] -= f
        if self._began:
            total += f
            total *= v
            self.dissipation += self.dt * float(total.sum()) / 2
        self._last, self._force, self._began = f, total, True

    def retime(self, dt: float) -> None:
        """Go on with another step [s]."""
        self.dt = dt

    def energy(self, state: Any) -> dict[str, float]:
        """Return the energy taken so far [J]; collective."""
        return {"damping": self.comm.allreduce(self.dissipation)}

    def memory(self) -> dict[str, Array]:
        """Return the energy taken on each rank; collective."""
        return {"dissipation": gathered(self.comm, self.dissipation)}

    def restore(self, memory: Mapping[str, Array]) -> None:
        """Go on from what :meth:`memory` returned."""
        self.dissipation = own_part(self.comm, memory["dissipation"])


@dataclass
class DriveTorque:
    """A torque on the nodes of a turning body about its own mean axis, ramped from zero.

    The force on a node is ``T m (n × r) / Σ m r²``, a rigid angular acceleration of that region.

    Attributes:
        dofs: Owned dof blocks of the region, shape ``(k,)``.
        mass: Their masses, shape ``(k,)`` [kg].
        reference: Their reference positions, shape ``(k, 3)`` [m].
        axis: Unit vector, shape ``(3,)``.
        torque: Final torque [N m].
        ramp: Time to reach it [s].
    """

    rest: ClassVar = None

    comm: MPI.Comm
    dofs: Dofs
    mass: Array
    reference: Array
    axis: Array
    torque: float
    ramp: float
    work: float = 0.0
    _before: float | None = field(default=None, repr=False)  # torque over inertia, at the last step

    def __post_init__(self) -> None:
        self.total = float(self.comm.allreduce(self.mass.sum()))
        self._arrays = {  # kept for the kernel
            "node": self.dofs.astype(np.int32),
            "mass": np.ascontiguousarray(self.mass),
            "place": np.ascontiguousarray(self.reference),
            "axis": np.array(self.axis, dtype=float),
            "last": np.zeros((len(self.dofs), 3)),
        }
        self._c = struct("nd_torque", k=len(self.dofs), **self._arrays)
        centre = self.comm.allreduce((self.mass[:, None] * self.reference).sum(axis=0)) / self.total
        turn = np.cross(self.axis, self.reference - centre)
        inertia = float((self.mass[:, None] * turn**2).sum())
        self.inertia = float(self.comm.allreduce(inertia))

    def _centre(self, u: Array) -> Array:
        """Return where the centre of mass is at the displacement ``u``, shape ``(3,)`` [m]."""
        moment = np.zeros(3)
        lib.nd_moment(self._c, pointer(u), pointer(moment))
        if self.comm.size > 1:
            self.comm.Allreduce(MPI.IN_PLACE, moment)
        return moment / self.total

    def add(self, state: Any, force: Any) -> None:
        """Add the torque and collect its work (trapezoidal in displacement).

        Between two steps ``Σ f₀ · Δu`` over all ranks is ``Σ f · Δu`` times the ratio of the
        torques: ``n ×`` is antisymmetric. The last force is therefore not kept.
        """
        torque = self.torque * (min(1.0, state.t / self.ramp) if self.ramp > 0 else 1.0)
        scale, u = torque / self.inertia, state.u.x.array
        centre = self._centre(u)
        work = lib.nd_turn(self._c, pointer(centre), scale, pointer(u), pointer(force.array))
        if self._before is not None:
            self.work += (self._before + scale) / 2 * work
        self._before = scale

    def energy(self, state: Any) -> dict[str, float]:
        """Return the work done so far [J]; collective."""
        return {"external_work": self.comm.allreduce(self.work)}

    def memory(self) -> dict[str, Array]:
        """Return the torque and the work done on each rank; collective."""
        return {"torque": np.array(self.torque), "work": gathered(self.comm, self.work)}

    def restore(self, memory: Mapping[str, Array]) -> None:
        """Go on from what :meth:`memory` returned."""
        self.torque = float(memory["torque"])
        self.work = own_part(self.comm, memory["work"])


@dataclass
class CarriedMass:
    """What added mass takes to follow a rigid rolling motion, ``m ω × (ω × r)``.

    Mass that is added to shorten no step should slow down vibrations, not resist the rolling: a
    kilogram on the tread of a wheel at 80 km/h would press on the rail with a kilonewton, which
    this force takes away. Only deviations from the rigid motion then feel the mass.

    Attributes:
        dofs: Owned dof blocks, shape ``(k,)``.
        mass: Added mass of each, shape ``(k,)`` [kg].
        reference: Their reference positions, shape ``(k, 3)`` [m].
        spin: Angular velocity, zero until the motion is known, shape ``(3,)`` [rad/s].
        centre: Centre of the rotation at t = 0, shape ``(3,)`` [m].
        velocity: Its velocity, shape ``(3,)`` [m/s].
    """

    rest: ClassVar = None

    comm: MPI.Comm
    dofs: Dofs
    mass: Array
    reference: Array
    spin: Array = field(default_factory=lambda: np.zeros(3))
    centre: Array = field(default_factory=lambda: np.zeros(3))
    velocity: Array = field(default_factory=lambda: np.zeros(3))
    work: float = 0.0
    _began: bool = field(default=False, repr=False)

    def __post_init__(self) -> None:
        self._arrays = {  # kept for the kernel
            "node": self.dofs.astype(np.int32),
            "mass": np.ascontiguousarray(self.mass),
            "place": np.ascontiguousarray(self.reference),
            "last": np.zeros((len(self.dofs), 3)),
            "before": np.zeros((len(self.dofs), 3)),
        }
        self._c = struct("nd_carried", k=len(self.dofs), **self._arrays)

    def add(self, state: Any, force: Any) -> None:
        """Add the force and collect its work (trapezoidal in displacement)."""
        centre = self.centre + state.t * self.velocity
        u, f = pointer(state.u.x.array), pointer(force.array)
        work = lib.nd_carry(self._c, pointer(centre), pointer(self.spin), u, f)
        if self._began:
            self.work += work / 2
        self._began = True

    def energy(self, state: Any) -> dict[str, float]:
        """Return the work done so far [J]; collective."""
        return {"external_work": self.comm.allreduce(self.work)}

    def memory(self) -> dict[str, Array]:
        """Return the motion, the same on all ranks, and the work of each; collective."""
        motion = np.array([self.spin, self.centre, self.velocity])
        return {"motion": motion, "work": gathered(self.comm, self.work)}

    def restore(self, memory: Mapping[str, Array]) -> None:
        """Go on from what :meth:`memory` returned."""
        self.spin, self.centre, self.velocity = (row.copy() for row in memory["motion"])
        self.work = own_part(self.comm, memory["work"])
