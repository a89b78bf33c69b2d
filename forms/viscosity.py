# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bulk viscosity: pressure against fast compression, which spreads shocks over a few cells.

von Neumann and Richtmyer (J. Appl. Phys. 21, 1950, 232–237) with the linear term of Landshoff, in
the form and with the constants of the large explicit codes.
"""

from collections.abc import Callable
from typing import Any

from ufl import min_value, tr
from ufl.domain import extract_unique_domain

from forms.cells import gradient_integral, per_point, positions, taylor, volume
from forms.time_step import cell_frequency, stable_step

LINEAR, QUADRATIC = 0.06, 1.5


def bulk_viscosity(
    u: Any,
    v: Any,
    w: Any,
    material: Any,
    *,
    linear: float = LINEAR,
    quadratic: float = QUADRATIC,
    rotating: bool = True,
) -> Any:
    """Return the virtual work of the viscous pressure, for the one-point measure [J/m³].

    For the mixed one where the same form has full quadrature on these cells.

    ``q = ρ l (quadratic l ε̇² − linear c ε̇)`` where the cell is compressed, ``ε̇ = v̇/v < 0``, else
    zero; its work is ``−q δv``. Volume v, rate and density are those of the whole cell now, so no
    rigid motion is felt; ``l = v^(1/3)``.

    Args:
        u: Displacement [m].
        v: Velocity [m/s].
        w: Virtual displacement [m].
        material: With ``rho`` [kg/m³] and ``dilatational_speed`` [m/s].
        linear: Constant of the linear term: damping ratio of a cubic cell's breathing [-].
        quadratic: Constant of the quadratic term [-].
        rotating: Volumes of the displaced cell; if not, of the cell at rest (small strain).
    """
    domain = extract_unique_domain(w)
    x = positions(domain)
    now = x + taylor(u) if rotating else x
    size = volume(now)
    rho = material.rho * volume(x) / size
    rate = min_value(tr(gradient_integral(taylor(v), now)) / size, 0)
    length = size ** (1 / 3)
    speed = material.dilatational_speed
    q = rho * length * (quadratic * length * rate**2 - linear * speed * rate)
    return -q * tr(gradient_integral(taylor(w), now)) * per_point(domain)


def tangent_viscosity(
    v: Any,
    w: Any,
    material: Any,
    *,
    linear: float = LINEAR,
    quadratic: float = QUADRATIC,
    rate: float = 0.0,
) -> Any:
    """Return the linear viscous work that bounds :func:`bulk_viscosity` at rates up to ``rate``.

    ``ρ l (linear c + 2 quadratic l |ε̇|) ε̇(v) δv``: the steepest tangent, in expansion too.

    Args:
        v: Velocity [m/s].
        w: Virtual displacement [m].
        material: With ``rho`` and ``dilatational_speed``.
        linear: Constant of the linear term [-].
        quadratic: Constant of the quadratic term [-].
        rate: Largest compression rate that is expected [1/s].
    """
    domain = extract_unique_domain(w)
    x = positions(domain)
    V = volume(x)
    length = V ** (1 / 3)
    slope = linear * material.dilatational_speed + 2 * quadratic * length * rate
    volumes = [tr(gradient_integral(taylor(f), x)) for f in (v, w)]
    return material.rho * length * slope * volumes[0] * volumes[1] / V * per_point(domain)


def damped_step(
    V: Any,
    residual: Callable[[Any, Any], Any],
    viscous: Callable[[Any, Any], Any],
    mass: Callable[[Any], Any],
    *,
    iterations: int = 4,
) -> float:
    """Return a stable step of central difference with viscous forces lagged by half a step [s].

    It is stable while ``dt²/4 K + dt/2 C < M``, and that while ``dt < g(dt) = 2/ω`` with ω of
    ``K + 2/dt C``, bounded cell by cell. ``dt ← g(dt)`` starts below the bound, where the largest
    ω and the largest damping are taken to be of one cell, and rises to it: each iterate is stable.

    Args:
        V: Vector P1 space.
        residual: ``residual(u, w)``, form of the internal forces.
        viscous: ``viscous(v, w)``, linear form of the viscous forces.
        mass: ``mass(w)``, form of the lumped mass.
        iterations: Of the fixed point.
    """
    frequency = cell_frequency(V, residual, mass)
    damping = cell_frequency(V, viscous, mass) ** 2
    dt = stable_step(frequency, damping / frequency**2)
    for _ in range(iterations):
        factor = 2 / dt

        def both(u: Any, w: Any, factor: float = factor) -> Any:
            return residual(u, w) + factor * viscous(u, w)

        dt = 2 / cell_frequency(V, both, mass)
    return float(dt)
