# SPDX-License-Identifier: LGPL-3.0-or-later
"""Friction laws: ``law(slip_rate, pressure, state) -> friction coefficient``.

A law is any callable on arrays over the nodes in contact:

* ``slip_rate`` ``(n,)`` [m/s], magnitude of the tangential slip velocity;
* ``pressure`` ``(n,)`` [Pa], normal force over tributary area;
* ``state``: :class:`LawState`, what a law with memory needs.

The coefficient multiplies the normal nodal force: ``|F_t| <= friction * F_n``.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


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

    ``friction = kinetic + (static - kinetic) * exp(-slip_rate / decay)``, decay in m/s.
    """
    _not_negative("static", static)
    _not_negative("kinetic", kinetic)
    if not (np.isfinite(decay) and decay > 0.0):
        raise ValueError(f"decay: expected a positive speed, got {decay} m/s")

    def law(slip_rate: Array, pressure: Array, state: LawState) -> Array:
        return kinetic + (static - kinetic) * np.exp(-slip_rate / decay)

    return law


def with_memory(steady: Law, length: float, floor: float = 1e-3) -> Law:
    """Return ``steady`` approached over a slip ``length``, so that answers do not depend on dt.

    ``d friction / dt = -max(slip_rate, floor) / length * (friction - steady)``, integrated
    exactly over the step; ``length`` in m, ``floor`` in m/s.
    """
    if not (length > 0.0 and floor > 0.0):
        raise ValueError(f"length, floor: expected positive values, got {length} m, {floor} m/s")

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
    bad = ~(np.isfinite(value) & (value >= 0.0))
    if bad.any():
        first = int(np.argmax(bad))
        raise ValueError(
            f"friction law: expected finite values >= 0, got {value[first]} at slip rate "
            f"{slip_rate[first]:.3e} m/s, pressure {pressure[first]:.3e} Pa"
        )
    return value
