# SPDX-License-Identifier: LGPL-3.0-or-later
"""Friction laws: ``law(slip_rate, pressure, state) -> friction coefficient``.

A law is any callable on arrays over the nodes in contact:

* ``slip_rate`` ``(n,)`` [m/s], magnitude of the tangential slip velocity;
* ``pressure`` ``(n,)`` [Pa], normal force over tributary area;
* ``state``: :class:`LawState`, what a law with memory needs.

The coefficient multiplies the normal nodal force: ``|F_t| <= friction * F_n``. The slip rate is the
whole relative velocity, that of the tangential springs included; it is zero where contact has just
begun. A law that falls with slip rate and has no memory gives answers that depend on step and mesh;
:func:`with_memory` mends that.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from meshes.arrays import Array


@dataclass(frozen=True)
class LawState:
    """What a law with memory may need, for the nodes in contact.

    Attributes:
        t: Time [s].
        dt: Time since the last step [s].
        node: HexMesh node, shape ``(n,)``.
        friction: Coefficient of the last step, NaN where contact has just begun, ``(n,)`` [-].
    """

    t: float
    dt: float
    node: npt.NDArray[np.int64]
    friction: Array


Law = Callable[[Array, Array, LawState], Array]


def _not_negative(name: str, value: float) -> float:
    if not (np.isfinite(value) and value >= 0.0):
        raise ValueError(f"{name}: expected a finite value >= 0, got {value}")
    return float(value)


def _positive(name: str, value: float, unit: str) -> None:
    if not (np.isfinite(value) and value > 0.0):
        raise ValueError(f"{name}: expected a finite value > 0, got {value} {unit}")


@dataclass(frozen=True)
class Coulomb:
    """Constant coefficient of friction."""

    friction: float

    def __post_init__(self) -> None:
        _not_negative("friction", self.friction)

    def __call__(self, slip_rate: Array, pressure: Array, state: LawState) -> Array:
        """Return the same coefficient for every node, shape ``(n,)``."""
        return np.full(slip_rate.shape, self.friction)


def coulomb(friction: float) -> Coulomb:
    """Return the law with one coefficient of friction, >= 0."""
    return Coulomb(friction)


def exponential(static: float, kinetic: float, decay: float) -> Law:
    """Return the law that falls from ``static`` at rest to ``kinetic`` at speed.

    ``friction = kinetic + (static - kinetic) * exp(-slip_rate / decay)``, decay in m/s. Polach's
    ``static * ((1 - A) * exp(-B * slip_rate) + A)`` (Wear 258, 2005, 992-1000) is the same with
    ``kinetic = A * static`` and ``decay = 1 / B``.

    Raises:
        ValueError: if a coefficient is negative or the decay is not positive.
    """
    _not_negative("static", static)
    _not_negative("kinetic", kinetic)
    _positive("decay", decay, "m/s")

    def law(slip_rate: Array, pressure: Array, state: LawState) -> Array:
        return kinetic + (static - kinetic) * np.exp(-slip_rate / decay)

    return law


def rational(static: float, kinetic: float, speed: float) -> Law:
    """Return the law that falls from ``static`` to ``kinetic`` as one over the slip rate.

    ``friction = kinetic + (static - kinetic) / (1 + slip_rate / speed)``, speed in m/s (Popp and
    Stelter, Phil. Trans. R. Soc. Lond. A 332, 1990, 89-105, without their quadratic term).

    Raises:
        ValueError: if a coefficient is negative or the speed is not positive.
    """
    _not_negative("static", static)
    _not_negative("kinetic", kinetic)
    _positive("speed", speed, "m/s")

    def law(slip_rate: Array, pressure: Array, state: LawState) -> Array:
        return kinetic + (static - kinetic) / (1.0 + slip_rate / speed)

    return law


def tabulated(slip_rate: Sequence[float], coefficient: Sequence[float]) -> Law:
    """Return the law through points, linear between them and constant beyond the last ones.

    Args:
        slip_rate: Increasing slip rates, the first >= 0, shape ``(k,)`` [m/s].
        coefficient: Coefficient at each, >= 0, shape ``(k,)`` [-].

    Raises:
        ValueError: if the points are not such.
    """
    rates, values = np.array(slip_rate, dtype=float), np.array(coefficient, dtype=float)
    if rates.shape != values.shape or rates.ndim != 1 or not rates.size:
        raise ValueError(
            f"slip_rate, coefficient: expected lists of one length, got shapes {rates.shape}, "
            f"{values.shape}"
        )
    if not (np.isfinite(rates).all() and rates[0] >= 0.0 and (np.diff(rates) > 0.0).all()):
        raise ValueError(f"slip_rate: expected increasing values >= 0 m/s, got {rates.tolist()}")
    if not (np.isfinite(values) & (values >= 0.0)).all():
        raise ValueError(f"coefficient: expected finite values >= 0, got {values.tolist()}")

    def law(slip_rate: Array, pressure: Array, state: LawState) -> Array:
        return np.interp(slip_rate, rates, values)

    return law


def with_memory(steady: Law, length: float, floor: float = 1e-3) -> Law:
    """Return ``steady`` approached over a slip ``length``, so that answers do not depend on dt.

    ``d friction / dt = -max(slip_rate, floor) / length * (friction - steady)``, integrated
    exactly over the step; ``length`` in m, ``floor`` in m/s: at rest the coefficient recovers in
    ``length / floor`` seconds. A node that comes into touch begins with the steady value at rest.

    Raises:
        ValueError: if the length or the floor is not positive.
    """
    _positive("length", length, "m")
    _positive("floor", floor, "m/s")

    def law(slip_rate: Array, pressure: Array, state: LawState) -> Array:
        goal = steady(slip_rate, pressure, state)
        left = np.exp(-np.maximum(slip_rate, floor) * state.dt / length)
        before = np.where(np.isnan(state.friction), goal, state.friction)
        return goal + left * (before - goal)

    return law


def as_law(friction: float | Law) -> Law:
    """Return ``friction`` as a law; a number means :func:`coulomb`.

    Raises:
        ValueError: if it is neither a finite number >= 0 nor callable.
    """
    if callable(friction):
        return friction
    if isinstance(friction, (int, float, np.integer, np.floating)):
        return coulomb(float(friction))
    raise ValueError(f"friction: expected a number >= 0 or a law, got {friction!r}")


def coefficients(law: Law, slip_rate: Array, pressure: Array, state: LawState) -> Array:
    """Return what the law gives, checked.

    Raises:
        ValueError: if the law returns another shape, or negative or non-finite values.
    """
    value = np.asarray(law(slip_rate, pressure, state), dtype=np.float64)
    if value.shape != slip_rate.shape:
        raise ValueError(f"friction law: expected shape {slip_rate.shape}, got {value.shape}")
    if value.size and not (value.min() >= 0.0 and value.max() < np.inf):  # nor not a number
        first = int(np.argmax(~(np.isfinite(value) & (value >= 0.0))))
        raise ValueError(
            f"friction law: expected finite values >= 0, got {value[first]} at slip rate "
            f"{slip_rate[first]:.3e} m/s, pressure {pressure[first]:.3e} Pa"
        )
    return value


# Slip rates and pressures of every contact that steel can bear, and beyond: a law is tried on all
# pairs of them before a run.
_TRIED_RATES = np.concatenate([[0.0], np.logspace(-9, 3, 25)])
_TRIED_PRESSURES = np.concatenate([[0.0], np.logspace(0, 11, 12)])


def tried(law: Law) -> Law:
    """Return the law after trying it on slip rates to 1 km/s and pressures to 100 GPa.

    Each is tried at the birth of a contact and with a coefficient before.

    Raises:
        ValueError: if it fails there, or returns another shape, negative or non-finite values.
    """
    rate, pressure = (a.ravel() for a in np.meshgrid(_TRIED_RATES, _TRIED_PRESSURES))
    node = np.arange(rate.size)
    for n in (rate.size, 1):
        for before in (np.nan, 0.0, 0.5):
            state = LawState(0.0, 1e-7, node[:n], np.full(n, before))
            try:
                law(rate[:n], pressure[:n], state)
            except Exception as error:
                message = f"friction law: failed with {type(error).__name__}: {error}"
                raise ValueError(message) from error
            coefficients(law, rate[:n], pressure[:n], state)
    return law
