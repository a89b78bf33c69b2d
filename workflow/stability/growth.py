# SPDX-License-Identifier: LGPL-3.0-or-later
"""Growing oscillation of a contact force, and whether the model itself is unstable.

Friction couples modes of two bodies that would be stable alone; their oscillation then grows in an
exact solution too. It is told from a fault of the numerics by what the latter cannot do: keep its
frequency and rate on every mesh and with a little stiffness damping. The bodies are run again for
that with springs as stiff as a constraint; friction comes on smoothly, since a sudden one lifts the
nodes off within few periods. Softer springs slow the oscillation down and let it grow less.
"""

import contextlib
import itertools
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from meshes.arrays import Array
from workflow.scene.scene import Scene
from workflow.simulation.guards import GuardError
from workflow.simulation.run import run

CELLS = (1.0, 2 / 3, 1 / 2)  # over those of the scene
DAMPINGS = (0.0, 50e-9)  # of stiffness, added to that of the scene [s]
STIFF = 10.0  # penalty of implicit springs: 2 % off the frequency of a constraint, damps growth
SAFETY = 0.9  # step over its bound
RAMP = 20e-6  # within which friction comes on [s]
FREQUENCY, RATE = 0.1, 0.25  # farthest from the mean of all runs, over it
SLOWER, FASTER = 0.6, 1.15  # frequency with the contact of the scene over that of the model
LIFT = 0.2  # force over that at rest, below which nodes lift off and growth is not exponential
PERIODS, EXPLAINED, POINTS = 1.25, 0.8, 40  # that a fit has at least
STARTS = (0.0, 0.1, 0.2, 0.3)  # of the window, at which fits begin
RATES = np.arange(-1.0, 4.0)  # tried at first, times the window
TURNS = np.arange(1.25, 20.0, 0.5)  # periods in the window, likewise


@dataclass(frozen=True)
class Growth:
    """An oscillation ``exp(rate t) cos(2π frequency t + phase)``.

    Attributes:
        rate, frequency: Means over fits that begin at different times [1/s, Hz].
        rate_error, frequency_error: Half the range of these fits [1/s, Hz].
        explained: Share of the force's variance about its trend [-].
        periods: In the window that was fitted [-].
    """

    rate: float
    frequency: float
    rate_error: float
    frequency_error: float
    explained: float
    periods: float

    @property
    def sure(self) -> bool:
        """Whether it is an oscillation of one frequency that grows, beyond doubt of the fit."""
        growing = self.rate > 2 * self.rate_error
        return growing and self.explained >= EXPLAINED and self.periods >= PERIODS


NONE = Growth(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def growth(t: Array, level: Array) -> Growth:
    """Fit a line and one growing oscillation to a force, up to where nodes lift off.

    Args:
        t: Times, evenly spaced [s].
        level: Force over that at rest, shape as ``t`` [-].
    """
    end = np.flatnonzero(level < LIFT)
    t, level = (a[: end[0] if len(end) else None] for a in (t, level))
    if len(t) < POINTS:
        return NONE
    starts = [round(share * len(t)) for share in STARTS]
    rate, frequency, explained = np.array([_fit(t[k:], level[k:]) for k in starts]).T
    return Growth(
        float(rate.mean()),
        float(frequency.mean()),
        float(np.ptp(rate)) / 2,
        float(np.ptp(frequency)) / 2,
        float(explained.min()),
        float(frequency.mean() * (t[-1] - t[0])),
    )


def _fit(t: Array, level: Array) -> tuple[float, float, float]:
    """Return rate [1/s], frequency [Hz] and explained share of the best fit."""
    window = t[-1] - t[0]
    x = (t - t[0]) / window

    def misfit(exponent: Array) -> Array:
        """What the best line, cosine and sine leave; linear in their four amplitudes."""
        wave = np.exp(complex(*exponent) * x)
        basis = np.column_stack([np.ones_like(x), x, wave.real, wave.imag])
        basis /= np.linalg.norm(basis, axis=0)
        return np.asarray(level - basis @ np.linalg.lstsq(basis, level, rcond=None)[0])

    tried = [np.array([s, 2 * np.pi * n]) for s in RATES for n in TURNS]
    best = least_squares(misfit, min(tried, key=lambda e: float(np.sum(misfit(e) ** 2))))
    left = level - np.polyval(np.polyfit(x, level, 1), x)
    explained = 1 - float(np.sum(best.fun**2) / max(np.sum(left**2), 1e-300))
    return float(best.x[0]) / window, abs(float(best.x[1])) / (2 * np.pi * window), explained


def itself(scene: Scene, contact: str) -> tuple[bool, str]:
    """Return whether the model of a sliding block is unstable by itself, and what was seen of it.

    Args:
        scene: A block on a base, with a coefficient of friction.
        contact: Name of its contact.
    """
    own = sliding_growth(scene, contact)
    if not own.sure:
        return False, ""
    found = model_growth(scene, contact)
    if not alike(found):
        return False, f"{told([own])}; with a stiff contact it {told(found)}, not alike"
    mean = float(np.mean([g.frequency for g in found]))
    same = SLOWER < own.frequency / mean < FASTER
    return same, f"{told([own])}; the model itself {told(found)}"


KNOWN: dict[str, list[Growth]] = {}  # of models that differ in contact and step only


def model_growth(scene: Scene, contact: str) -> list[Growth]:
    """Return the growth with stiff contact at three sizes of cells and two dampings.

    Ends at the first run that has no growth: the finest ones cost most.
    """
    kept = scene.contacts[contact].model_dump(include={"contactor", "target", "friction"})
    stiff = {**kept, "method": "implicit-penalty", "penalty": STIFF}
    step = {"time.safety": SAFETY, "time.precision": "float64"}
    scene = scene.with_(contacts={contact: stiff}, **step)
    key = scene.model_dump_json()
    if key not in KNOWN:
        KNOWN[key] = found = []
        for cells, damping in itertools.product(CELLS, DAMPINGS):
            found.append(sliding_growth(refined(scene, cells, damping), contact))
            if not found[-1].sure:
                break
    return KNOWN[key]


def refined(scene: Scene, cells: float, damping: float) -> Scene:
    """Return a block on a base with cells so much larger and more stiffness damping [s]."""
    sizes = {f"mesh.{key}": cells * getattr(scene.mesh, key) for key in ("size", "base_size")}
    damped = {
        f"bodies.{name}.stiffness_damping": body.stiffness_damping + damping
        for name, body in scene.bodies.items()
    }
    return scene.with_(**sizes, **damped)


def sliding_growth(scene: Scene, contact: str) -> Growth:
    """Return the growth in a run whose friction comes on smoothly, from when it is there."""
    s = f"(t / {RAMP})"
    law = f"{scene.contacts[contact].friction} * where(t < {RAMP}, {s}**2 * (3 - 2 * {s}), 1)"
    key = f"contacts.{contact}.friction"
    t, force = force_of(scene.with_(**{key: {"law": "expression", "expression": law}}), contact)
    late = t >= RAMP
    return growth(t[late], force[late] / force[0]) if force[0] > 0 else NONE


def force_of(scene: Scene, contact: str) -> tuple[Array, Array]:
    """Return the times and normal forces of a run, up to where a guard has stopped it [s, N]."""
    rows: list[tuple[float, float]] = []
    with tempfile.TemporaryDirectory() as scratch, contextlib.suppress(GuardError):
        run(
            scene,
            Path(scratch) / "out",
            watch=lambda m: rows.append((m.state.t, m.pairs[contact].normal_force)),
            quiet=True,
        )
    t, force = np.array(rows).T
    return t, force


def alike(found: Sequence[Growth]) -> bool:
    """Whether all runs were made and grow at one frequency and rate, within the stated bands."""
    if len(found) < len(CELLS) * len(DAMPINGS) or not all(g.sure for g in found):
        return False
    frequency, rate = np.array([(g.frequency, g.rate) for g in found]).T
    return spread(frequency) <= FREQUENCY and spread(rate) <= RATE


def spread(values: Array) -> float:
    """Return how far the farthest of some values is from their mean, over it [-]."""
    return float(np.max(np.abs(values / values.mean() - 1)))


def told(found: Sequence[Growth]) -> str:
    """Return frequencies and rates of some runs in words."""
    sure = [g for g in found if g.sure]
    if not sure:
        return "does not grow at one frequency"
    frequency, rate = np.array([(g.frequency, g.rate) for g in sure]).T
    words = (
        f"grows by {between(rate, '.2g')} ± {max(g.rate_error for g in sure):.1g} per second "
        f"at {between(frequency / 1e3, '.0f')} kHz"
    )
    if len(found) == 1:
        return words
    return f"{words} in {len(sure)} runs" + " and not in the next" * (len(sure) < len(found))


def between(values: Array, layout: str) -> str:
    """Return the range of some values in words."""
    ends = [f"{float(v):{layout}}" for v in (values.min(), values.max())]
    return " to ".join(dict.fromkeys(ends))
