# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pressure and shear of smooth bodies at the last output, the closed form behind."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from workflow import theme
from workflow.figures_closed_forms import Smooth, checked, smooth
from workflow.recorded import Patch, Record
from workflow.theme import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from contact.theory.closed_forms import Hertz

MM, MPA = 1e3, 1e-6
EXACT: dict[str, Any] = {"color": theme.CLOSED_FORM, "lw": 3.5}
INNER = 0.9  # of the contact, where nodes are compared: the edge is a matter of half a cell


def pressure(record: Record) -> "Figure | None":
    """Pressure at the last output in contact, Hertz behind; shear of Carter or Cattaneo.

    Closed forms are those under the normal (and tangential) force of that output.
    """
    bodies = smooth(record)
    if bodies is None or not record.contacts:
        return None
    patch = last_patch(record)
    hertz, at = bodies.hertz(patch.normal_force), bodies.local(patch)
    where, line, label = _abscissa(bodies, hertz, at)
    sheared = _traction(record, bodies, patch, hertz)
    fig = theme.figure(theme.PAGE if sheared else theme.COLUMN, 2.8)
    panels = fig.subplots(1, 1 + bool(sheared), squeeze=False)[0]
    exact = hertz.pressure(line[:, 0] * hertz.a)
    nodal, there = patch.pressing / patch.areas, hertz.pressure(*at.T)
    inside = np.hypot(at[:, 0] / hertz.a, at[:, 1] / hertz.b) < INNER
    error = _rms(nodal, there, inside, hertz.p0)
    _compare(panels[0], (line[:, 1], exact), (where, nodal), "Hertz", error)
    panels[0].set(xlabel=label, ylabel="pressure [MPa]")
    if sheared:
        name, theory, shear = sheared
        exact = theory(line[:, 0] * hertz.a)
        radius = at[:, 0] if bodies.plane else np.hypot(*at.T)
        error = _rms(shear, theory(radius), inside, float(exact.max()))
        _compare(panels[1], (line[:, 1], exact), (where, shear), name, error)
        panels[1].set(xlabel=label, ylabel="shear stress [MPa]")
        theme.letter(panels[0], "a", "pressure")
        theme.letter(panels[1], "b", "shear")
    return fig


def last_patch(record: Record) -> Patch:
    """Return the patch with most force of the last output in contact."""
    contact = next(iter(record.contacts.values()))
    patches = next(p for p in reversed(contact.patches) if p)
    return max(patches.values(), key=lambda p: p.normal_force)


def _abscissa(bodies: Smooth, hertz: "Hertz", at: Array) -> tuple[Array, Array, str]:
    """Return where nodes are drawn, where the closed form is (x/a and abscissa), and the label."""
    share = np.linspace(-1 if bodies.plane and not bodies.halved[0] else 0, 1, 401)
    if bodies.plane:
        return at[:, 0] * MM, np.column_stack([share, share * hertz.a * MM]), "along x [mm]"
    if np.isclose(hertz.a, hertz.b):
        line = np.column_stack([share, share * hertz.a * MM])
        return np.hypot(*at.T) * MM, line, "distance from the centre [mm]"
    r = np.hypot(at[:, 0] / hertz.a, at[:, 1] / hertz.b)
    return r, np.column_stack([share, share]), "distance from the centre / half axis [-]"


def _traction(
    record: Record, bodies: Smooth, patch: Patch, hertz: "Hertz"
) -> tuple[str, Callable[[Array], Array], Array] | None:
    """Return name, closed form and nodal values of the shear along x [Pa], None if there is none.

    The closed form takes x in plane strain, the distance from the centre else [m].
    """
    from contact.theory.closed_forms import carter_stick_ratio, carter_traction, cattaneo_mindlin

    scene = checked(record)
    friction = next(iter(scene.contacts.values())).friction
    resultant = patch.traction[:, 0].sum()
    P, Q = bodies.whole(patch.normal_force), bodies.whole(abs(resultant))
    if not isinstance(friction, float) or not 0 < Q <= friction * P or not scene.driven:
        return None
    shear = np.sign(resultant) * patch.traction[:, 0] / patch.areas
    if bodies.plane and bodies.rolls:
        below = [d.velocity[0] for d in scene.driven.values() if not any(d.spin)]
        ahead = -np.sign(below[0]) if below and below[0] else 1.0
        ratio = carter_stick_ratio(Q, P, friction)
        return "Carter", lambda x: carter_traction(ahead * x, hertz, ratio, friction), shear
    if not bodies.plane and not bodies.rolls and np.isclose(hertz.a, hertz.b):
        return "Cattaneo, Mindlin", lambda r: cattaneo_mindlin(r, hertz, Q, P, friction), shear
    return None


def _rms(nodal: Array, exact: Array, inside: npt.NDArray[np.bool_], scale: float) -> float:
    """Return the root mean square of the error inside, over ``scale``."""
    off = (nodal - exact)[inside]
    return float(np.sqrt((off**2).mean())) / scale if len(off) else float("nan")


def _compare(
    axes: "Axes", exact: tuple[Array, Array], nodal: tuple[Array, Array], name: str, error: float
) -> None:
    axes.plot(exact[0], exact[1] * MPA, **EXACT, label=f"{name}, same force")
    axes.plot(nodal[0], nodal[1] * MPA, ".", color=theme.PATCH[1], ms=3.5,
              label=f"contact nodes, {100 * error:.1f} % rms")  # fmt: skip
    axes.set_ylim(bottom=min(0.0, 1.05 * float(nodal[1].min()) * MPA))
    axes.set_ylim(top=1.28 * axes.get_ylim()[1])
    axes.legend(loc="upper right", ncols=1)
