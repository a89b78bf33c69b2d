# SPDX-License-Identifier: LGPL-3.0-or-later
"""Limits of stability found by running, against what ``squealx audit`` predicts without."""

import csv
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from mpi4py import MPI  # noqa: F401 (before DOLFINx)

import numpy as np

from workflow.audit.limits import Limits
from workflow.model.model import Model, attach, build
from workflow.scene.scene import Scene
from workflow.simulation.energy import Ledger
from workflow.simulation.guards import GuardError, Watch, check_finite
from workflow.simulation.initial import start
from workflow.simulation.stepping import steps
from workflow.stability.cases import HEIGHT, PRESSURE, QUIET, SLIDE, E, implicit, material

STEPS = 1000  # a limit exceeded by 0.1 % grows round-off to a blow-up within so many
GROWTH = 1.5  # energy over what there was, which no stable run reaches


SMALL = {**QUIET, **SLIDE, "mesh.size": 0.004, "mesh.base_size": 0.0047}
FACE = "contacts.face."
FRICTIONLESS = {FACE + "friction": 0.0}

# what is changed in the sliding block, and which limits of it are looked for
TRIED: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    "friction 0": (FRICTIONLESS, ("step", "penalty", "damping")),
    "friction 0.3": ({}, ("step", "penalty", "damping")),
    "friction 0.3, at rest": ({"bodies.block.velocity": [0.0, 0.0, 0.0]}, ("step", "penalty")),
    "penalty 0.01": ({FACE + "penalty": 0.01}, ("step",)),
    "penalty 2": ({FACE + "penalty": 2.0}, ("step",)),
    "two-pass, friction 0": ({FACE + "two_pass": True, **FRICTIONLESS}, ("step", "penalty")),
    "modulus-penalty 1, friction 0": (
        {FACE + "method": "modulus-penalty", FACE + "penalty": 1.0, **FRICTIONLESS},
        ("step", "penalty"),
    ),
    "implicit-penalty 30": (implicit(30, "face"), ("step",)),
    "contact damping 0.3": ({FACE + "damping": 0.3}, ("step",)),
    "stiffness damping 0.2 µs": ({"bodies.block.stiffness_damping": 2e-7}, ("step",)),
    "one-point": ({f"bodies.{b}.element": "one-point" for b in ("block", "base")}, ("step",)),
    "base 1000 times softer": (
        {
            "bodies.base.material": material(E / 1e3),
            "loads": [{"surface": "zmax", "traction": [0.0, 0.0, -PRESSURE / 1e3]}],
        },
        ("step", "penalty"),
    ),
    "block of a fifth of the height": (
        {"mesh.block": [0.02, 0.02, HEIGHT / 5], "mesh.size": HEIGHT / 5},
        ("step",),
    ),
}
QUICK = ("friction 0", "friction 0.3")


@dataclass(frozen=True)
class Limit:
    """The largest stable value of a key.

    Attributes:
        case: What was run.
        key: ``step`` [s], ``penalty`` at the step of the scene [-] or ``damping`` [-].
        predicted: By the audit.
        found: By bisection of runs.
        scene: The step and the bound a scene keeps to [s], its penalty or damping [-].
    """

    case: str
    key: str
    predicted: float
    found: float
    scene: float

    @property
    def ratio(self) -> float:
        """Predicted over found: above 1 is optimistic."""
        return self.predicted / self.found


def limits(out: Path, *, quick: bool, log: Callable[[str], Any]) -> list[dict[str, Any]]:
    """Find all limits that the folder does not have; return the rows of ``limits.csv``.

    Args:
        out: Folder of the matrix.
        quick: Only the first cases.
        log: Called with a line for each limit.
    """
    file = out / "limits.csv"
    rows: list[dict[str, Any]] = []
    if file.is_file():
        with file.open(encoding="utf-8", newline="") as table:
            rows = [{k: number(v) for k, v in row.items()} for row in csv.DictReader(table)]
    known = {(row["case"], row["key"]) for row in rows}
    wanted = [(c, k) for c, (_, keys) in TRIED.items() for k in keys if not quick or c in QUICK]
    for case, key in wanted:
        if (case, key) in known:
            continue
        found = limit(case, key)
        rows.append({**asdict(found), "ratio": found.ratio})
        log(f"limit of {key}, {case}: {found.predicted:.4g} predicted, {found.found:.4g} found")
        with file.open("w", encoding="utf-8", newline="") as table:
            writer = csv.DictWriter(table, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
    return rows


def number(text: str) -> float | str:
    """Return a cell of a table as a number if it is one."""
    try:
        return float(text)
    except ValueError:
        return text


def limit(case: str, key: str, within: float = 0.005) -> Limit:
    """Predict and find one limit.

    Args:
        case: A key of :data:`TRIED`.
        key: ``step``, ``penalty`` or ``damping``.
        within: Accuracy of the bisection [-].
    """
    scene = Scene.load("sliding-block", **{**SMALL, **TRIED[case][0]})
    model = build(scene)
    start(model, lambda line: None)
    foreseen, dt, face = Limits(model), model.dt, scene.contacts["face"]
    kept = {"step": model.dt_bound, "penalty": face.penalty, "damping": face.damping}
    if key == "step":
        guess = foreseen.step()
        found = largest(lambda h: not blows_up(restepped(build(scene), h)), guess, within)
        return Limit(case, key, guess, found, kept[key])
    guess = foreseen.damping(dt) if key == "damping" else foreseen.penalty(dt) * face.penalty

    def stable(value: float) -> bool:
        return not blows_up(restepped(build(scene.with_(**{FACE + key: value})), dt))

    return Limit(case, key, guess, largest(stable, guess, within), kept[key])


def restepped(model: Model, dt: float) -> Model:
    """Return the model with another step, nothing of its contact begun, in place."""
    model.dt = dt
    if model.connections is not None:
        model.connections.dt = dt
    model.items = [item for item in model.items if not hasattr(item, "footprint")]
    attach(model)
    return model


def blows_up(model: Model, count: int = STEPS) -> str:
    """Step a model from its start with its guards; return what stopped it, empty if nothing did.

    Energy that grows beyond :data:`GROWTH` times what there was counts too, so that a limit does
    not depend on how soon a guard sees it. The balance is taken over all energy, not over the work
    of the contact: what nodes that cross facets make is another matter than the limit of the step.
    """
    start(model, lambda line: None)
    ledger, watch = Ledger(model), Watch(model)
    given = 0.0
    try:
        for state in steps(model, count * model.dt):
            check_finite(model)
            if state.step % 10 == 0:
                energy, error = ledger.measure()
                stored = energy.internal + energy.hourglass + energy.contact + energy.spring
                watch.check_contacts()
                if not abs(error) <= model.scene.guards.energy_error:
                    return f"energy balance error {error:.2%} at step {state.step}"
                begun = abs(energy.external_work)
                given = given or abs(energy.kinetic) + stored
                if max(abs(energy.kinetic), stored) > GROWTH * (given + begun):
                    return f"energy has grown {GROWTH} times at step {state.step}"
    except (GuardError, RuntimeError) as stop:
        return str(stop)
    return ""


def largest(stable: Callable[[float], bool], guess: float, within: float = 0.005) -> float:
    """Return the largest stable value by bisection, to a share ``within`` of it.

    Args:
        stable: Whether a value is.
        guess: Where to begin; the limit is looked for up to 16 times away.
        within: Width of the last bracket over the value [-].
    """
    low = high = guess
    while not stable(low):
        low, high = low / 1.1 ** (1 + (low < 0.8 * guess) * 4), low
        if low < guess / 16:
            return 0.0
    while high <= low or stable(high):
        low, high = high, high * 1.1 ** (1 + (high > 1.2 * guess) * 4)
        if high > 16 * guess:
            return np.inf
    while high - low > within * low:
        middle = (low + high) / 2
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low
