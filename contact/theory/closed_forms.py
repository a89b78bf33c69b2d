# SPDX-License-Identifier: LGPL-3.0-or-later
"""Closed forms of contact: Hertz, Cattaneo-Mindlin, Carter, impacts, sliding, slip weakening.

Sources: K. L. Johnson, Contact Mechanics (1985), equations named in the functions.
"""

from dataclasses import dataclass

import numpy as np

from meshes.arrays import Array


@dataclass(frozen=True)
class Hertz:
    """Frictionless contact of smooth elastic bodies.

    Attributes:
        a: Half width of the patch along x [m].
        b: Half width along y [m]; infinite for line contact.
        p0: Largest pressure [Pa].
        approach: How far distant points come together [m]; NaN for line contact.
    """

    a: float
    b: float
    p0: float
    approach: float

    def pressure(self, x: Array, y: Array | float = 0.0) -> Array:
        """Return the pressure at ``x, y`` from the centre of the patch [Pa]."""
        inside = 1.0 - (np.asarray(x) / self.a) ** 2 - (np.asarray(y) / self.b) ** 2
        return self.p0 * np.sqrt(np.maximum(inside, 0.0))


def _positive(**values: float) -> None:
    for name, value in values.items():
        if not (np.isfinite(value) and value > 0.0):
            raise ValueError(f"{name}: expected a finite value > 0, got {value}")


def contact_modulus(E1: float, nu1: float, E2: float = np.inf, nu2: float = 0.0) -> float:
    """Return E* of two bodies [Pa]; a rigid second one if left out."""
    return 1.0 / ((1.0 - nu1**2) / E1 + (1.0 - nu2**2) / E2)


def hertz_sphere(load: float, radius: float, modulus: float) -> Hertz:
    """Return the contact of a sphere on a flat (Johnson 4.22-4.24).

    Args:
        load: Normal force [N].
        radius: Radius of the relative curvature [m].
        modulus: Contact modulus E* [Pa].
    """
    _positive(load=load, radius=radius, modulus=modulus)
    a = (0.75 * load * radius / modulus) ** (1.0 / 3.0)
    return Hertz(a, a, 1.5 * load / (np.pi * a**2), a**2 / radius)


def hertz_line(load: float, radius: float, modulus: float) -> Hertz:
    """Return the contact of parallel cylinders (Johnson 4.43-4.45); load per length [N/m]."""
    _positive(load=load, radius=radius, modulus=modulus)
    a = 2.0 * np.sqrt(load * radius / (np.pi * modulus))
    return Hertz(float(a), np.inf, float(2.0 * load / (np.pi * a)), np.nan)


def line_compression(hertz: Hertz, depth: float, E: float, nu: float) -> float:
    """Return how much nearer the surface comes to a point below the middle of line contact [m].

    The strain on the axis of a half-space, of the stresses of Johnson (4.46), summed to ``depth``.

    Args:
        hertz: The contact.
        depth: Depth of the point [m].
        E: Young's modulus of the body [Pa].
        nu: Its Poisson's ratio [-].
    """
    _positive(depth=depth, E=E)
    a, d = hertz.a, depth
    vertical = a * np.arcsinh(d / a)
    along = (d * np.hypot(a, d) - d**2) / a
    return float(hertz.p0 * (1 + nu) / E * ((1 - nu) * vertical - nu * along))


def hertz_ellipse(load: float, radius_x: float, radius_y: float, modulus: float) -> Hertz:
    """Return the contact of general curved bodies (Johnson 4.26-4.33).

    Args:
        load: Normal force [N].
        radius_x: Radius of the relative curvature along x, 1 / (1/R1x + 1/R2x) [m].
        radius_y: The same along y [m].
        modulus: Contact modulus E* [Pa].
    """
    from scipy.optimize import brentq  # half as long to import as a small scene takes
    from scipy.special import ellipe, ellipk

    _positive(load=load, radius_x=radius_x, radius_y=radius_y, modulus=modulus)
    flat, steep = max(radius_x, radius_y), min(radius_x, radius_y)
    if flat / steep < 1.0 + 1e-7:
        return hertz_sphere(load, radius_x, modulus)

    def ratio(m: float) -> float:  # of the curvatures, as a function of eccentricity squared
        K, E = ellipk(m), ellipe(m)
        return float((E / (1.0 - m) - K) / (K - E) - flat / steep)

    m = float(brentq(ratio, 1e-8, 1.0 - 1e-14, xtol=1e-15))
    K, E = ellipk(m), ellipe(m)
    a = (3.0 * load * flat * (K - E) / (np.pi * modulus * m)) ** (1.0 / 3.0)
    b = a * np.sqrt(1.0 - m)
    p0 = 1.5 * load / (np.pi * a * b)
    long_x = radius_x >= radius_y
    axes = (float(a), float(b)) if long_x else (float(b), float(a))
    return Hertz(*axes, float(p0), float(p0 / modulus * b * K))


def stick_radius_ratio(tangential: float, normal: float, friction: float) -> float:
    """Return c/a of Cattaneo and Mindlin (Johnson 7.42): stick circle over contact circle."""
    _positive(normal=normal, friction=friction)
    left = 1.0 - abs(tangential) / (friction * normal)
    if left < 0.0:
        raise ValueError(f"tangential: expected at most {friction * normal} N, got {tangential} N")
    return float(left ** (1.0 / 3.0))


def cattaneo_mindlin(
    r: Array, hertz: Hertz, tangential: float, normal: float, friction: float
) -> Array:
    """Return the shear traction at radius ``r`` [Pa] for a tangential load after a normal one."""
    ratio = stick_radius_ratio(tangential, normal, friction)
    full = friction * hertz.pressure(r)
    if ratio == 0.0:
        return full
    inner = np.sqrt(np.maximum(1.0 - (np.asarray(r) / (ratio * hertz.a)) ** 2, 0.0))
    return full - friction * hertz.p0 * ratio * inner


def carter_stick_ratio(tangential: float, normal: float, friction: float) -> float:
    """Return the stick half width over the contact half width, at the leading edge (8.15)."""
    _positive(normal=normal, friction=friction)
    left = 1.0 - abs(tangential) / (friction * normal)
    if left < 0.0:
        raise ValueError(f"tangential: expected at most {friction * normal} N, got {tangential} N")
    return float(np.sqrt(left))


def carter_creepage(
    tangential: float, normal: float, friction: float, half_width: float, radius: float
) -> float:
    """Return the longitudinal creepage of a driven cylinder; its sign opposes the traction.

    Args:
        tangential: Traction per length on the cylinder [N/m].
        normal: Normal load per length [N/m].
        friction: Coefficient of friction [-].
        half_width: Half width of the contact [m].
        radius: Radius of the relative curvature [m].
    """
    ratio = carter_stick_ratio(tangential, normal, friction)
    return float(-np.sign(tangential) * friction * half_width / radius * (1.0 - ratio))


def carter_traction(x: Array, hertz: Hertz, ratio: float, friction: float) -> Array:
    """Return the shear traction [Pa] at ``x``, leading edge at ``+a`` (Johnson 8.13, 8.14).

    ``ratio`` is :func:`carter_stick_ratio`; the stick zone ends at the leading edge.
    """
    full = friction * hertz.pressure(x)
    if ratio == 0.0:
        return full
    c = ratio * hertz.a
    inner = 1.0 - ((np.asarray(x) - (hertz.a - c)) / c) ** 2
    return full - friction * hertz.p0 * ratio * np.sqrt(np.maximum(inner, 0.0))


def bar_impact(
    speed: float, E: float, rho: float, area: float, length: float
) -> tuple[float, float]:
    """Return the force rho c v A [N] and duration 2 L / c [s] of a bar that hits a rigid wall."""
    _positive(E=E, rho=rho, area=area, length=length)
    c = np.sqrt(E / rho)
    return float(rho * c * speed * area), float(2.0 * length / c)


def sphere_impact_time(mass: float, radius: float, modulus: float, speed: float) -> float:
    """Return the contact time of a Hertzian impact [s] (Johnson 11.24)."""
    _positive(mass=mass, radius=radius, modulus=modulus, speed=speed)
    return float(2.8683 * (mass**2 / (radius * modulus**2 * speed)) ** 0.2)


def sphere_impact_approach(mass: float, radius: float, modulus: float, speed: float) -> float:
    """Return the largest approach of a Hertzian impact [m] (Johnson 11.22)."""
    _positive(mass=mass, radius=radius, modulus=modulus, speed=speed)
    return float((15 * mass * speed**2 / (16 * np.sqrt(radius) * modulus)) ** 0.4)


def sliding_stop(speed: float, friction: float, gravity: float = 9.81) -> tuple[float, float]:
    """Return the distance [m] and time [s] in which friction stops a sliding block."""
    _positive(friction=friction, gravity=gravity)
    return speed**2 / (2.0 * friction * gravity), abs(speed) / (friction * gravity)


def stick_slip_period(speed: float, stiffness: float, mass: float, drop: float) -> float:
    """Return the time between two jumps of a block that is pulled by a spring [s].

    While it sticks the spring gains ``2 drop / stiffness``; it slips from rest to rest with
    ``tan(ω t / 2) = -drop ω / (stiffness speed)``.

    Args:
        speed: Of the pulled end of the spring [m/s].
        stiffness: Of the spring [N/m].
        mass: Of the block [kg].
        drop: Friction at rest less that in slip, constant each [N].
    """
    omega = np.sqrt(stiffness / mass)
    slip = 2 * (np.pi - np.arctan(drop * omega / (stiffness * speed))) / omega
    return float(2 * drop / (stiffness * speed) + slip)


def slip_weakening_work(slip: float, static: float, kinetic: float, length: float) -> float:
    """Return the work of friction over a slip for a unit of normal force [m].

    The coefficient falls as ``kinetic + (static − kinetic) exp(−slip / length)``.

    Args:
        slip: Slip since rest [m].
        static: Coefficient of friction at rest [-].
        kinetic: Coefficient after much slip [-].
        length: Slip over which it falls [m].
    """
    _positive(length=length)
    return float(kinetic * slip - (static - kinetic) * length * np.expm1(-slip / length))


def sinking(hertz: Hertz, depth: float, E: float, nu: float) -> float:
    """Return how far a point below the middle of point contact sinks in its half-space [m].

    Boussinesq's point force (Johnson 3.19) summed over the ellipse by Gauss points; half of the
    approach at no depth where both bodies are alike.

    Args:
        hertz: The contact.
        depth: Depth of the point [m].
        E: Young's modulus of the body [Pa].
        nu: Its Poisson's ratio [-].
    """
    _positive(depth=depth, E=E)
    node, weight = np.polynomial.legendre.leggauss(40)
    s = np.pi / 4 * (node + 1)  # x = a sin s cos w, so that the pressure is smooth up to the edge
    w = np.pi / 4 * (node + 1)
    r = np.sin(s)[:, None] * np.hypot(hertz.a * np.cos(w), hertz.b * np.sin(w))
    R = np.hypot(r, depth)
    force = hertz.p0 * hertz.a * hertz.b * np.cos(s) ** 2 * np.sin(s)
    ring = (depth**2 / R**3 + 2 * (1 - nu) / R) * force[:, None]
    return float((1 + nu) / (2 * np.pi * E) * 4 * (np.pi / 4) ** 2 * (weight @ ring @ weight))
