# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs of the stability matrix and their verdicts.

Verdicts: ``accurate``; ``wrong``, stable but off by more than the tolerance of a measure;
``model``, off because the model itself is unstable (:mod:`workflow.stability.growth`);
``refused`` as bad input; ``caught``, stopped by a guard; and ``unseen``, a run that went wild and
reached its end, or failed without a message: a defect.
"""

import csv
import json
import multiprocessing
import os
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from contact.theory.closed_forms import hertz_line, hertz_sphere
from meshes.arrays import Array
from meshes.formats import read_write
from meshes.tags import Tag
from workflow.model.geometry import mesh_of
from workflow.model.model import Model
from workflow.scene.bodies import Isotropic
from workflow.scene.mesh import CapMesh, CurvedMesh
from workflow.scene.scene import Scene, SceneError
from workflow.simulation.guards import GuardError
from workflow.simulation.ranks import OWN_MODULES
from workflow.simulation.run import run
from workflow.stability import growth
from workflow.stability.cases import BASES, CELL, HEIGHT, QUIET, RHO, SPEED, Case, cases

TOLERANCES = {
    "normal force": 0.02,
    "change of speed": 0.02,
    "tangential force": 0.02,
    "ripple": 0.2,
    "depth / cell": 0.05,
    "pressure": 0.05,
    "elongation": 0.02,
    "energy": 0.01,
    "contact energy": 1e-3,
}
WILD = 1.5  # energy over all that a run was given, which nothing but a blow-up exceeds


@dataclass(frozen=True)
class Verdict:
    """What became of a case.

    Attributes:
        kind: ``accurate``, ``model``, ``wrong``, ``refused``, ``caught`` or ``unseen``.
        measure: The measure that is furthest off, over its tolerance; empty without a run.
        value: Its value [-].
        message: Of the guard or of the refusal, or what was found of a growing oscillation.
        steps: Steps done.
        step_over_bound: Step over the bound of the scene [-].
        seconds: Wall time [s].
        measures: All measures.
    """

    kind: str
    measure: str
    value: float
    message: str
    steps: int
    step_over_bound: float
    seconds: float
    measures: dict[str, float]


def scene_of(case: Case, folder: Path) -> Scene:
    """Return the scene of a case; a changed mesh goes through a file in ``folder``.

    Raises:
        SceneError: if the case is refused.
    """
    name, base = BASES[case.base]
    scene = Scene.load(name, **{**QUIET, **base, **case.changes})
    if not case.moved:
        return scene
    mesh, _ = mesh_of(scene)
    points = mesh.points * np.array(case.moved.get("scale", (1.0, 1.0, 1.0)))
    block = mesh.nodes(Tag.BLOCK)
    points[block] += np.array(case.moved.get("block", (0.0, 0.0, 0.0)))
    points += np.array(case.moved.get("all", (0.0, 0.0, 0.0)))
    path = folder / "mesh.vtu"
    read_write.write(type(mesh)(**{**vars(mesh), "points": points}), path)
    thin = case.moved.get("scale", (1.0, 1.0, 1.0))[2]
    table = {"kind": "file", "path": str(path), "size": CELL * thin}
    return scene.with_(mesh=table)


class Seen:
    """What is noted at every step of a run: forces, depth, motion.

    Args:
        case: The case.
    """

    def __init__(self, case: Case) -> None:
        self.case = case
        self.rows: list[tuple[float, ...]] = []
        self.speeds: list[Array] = []
        self.model: Model | None = None
        self.pressure: Array = np.zeros(0)

    def __call__(self, model: Model) -> None:
        """Note one step; start the spin at the first."""
        self.model = model
        if model.state.step == 0 and self.case.spin:
            spun(model, self.case.spin)
        pairs = list(model.pairs.values())
        if pairs:
            pair = pairs[0]
            tangential = float(np.linalg.norm(pair.tangential_force))
            depth, taken = pair.max_penetration, pair.damping_dissipation
            self.rows.append((model.state.t, pair.normal_force, tangential, depth, taken))
            if self.case.base == "slide":
                self.speeds.append(mean_velocity(model, "block"))
            elif self.case.base in ("press", "load", "corner"):
                peak = pair.footprint().pressure
                self.pressure = np.append(self.pressure, float(np.max(peak, initial=0.0)))
        elif self.case.base == "spin":
            self.rows.append((model.state.t, elongation(model)))

    @property
    def table(self) -> Array:
        """Rows as an array, ``(steps, columns)``."""
        return np.array(self.rows)


def mean_velocity(model: Model, body: str) -> Array:
    """Return the velocity of a body's centre of mass half a step ago [m/s]; serial."""
    dofs = model.bodies.dofs(body)
    m = model.mass.array[::3][dofs]
    return np.asarray(m @ model.state.v.x.array.reshape(-1, 3)[dofs] / m.sum())


def spun(model: Model, spin: float) -> None:
    """Give the bar an angular velocity about z through its middle."""
    x = model.domain.V.tabulate_dof_coordinates()
    r = x - (x.min(axis=0) + x.max(axis=0)) / 2
    v = spin * np.column_stack([-r[:, 1], r[:, 0], np.zeros(len(r))])
    model.state.v.x.array.reshape(-1, 3)[: len(r)] = v[: len(r)]
    model.state.v.x.scatter_forward()


def elongation(model: Model) -> float:
    """Return how much farther the ends of the bar are apart than at rest [m]; serial."""
    x = model.domain.V.tabulate_dof_coordinates()
    y = x + model.state.u.x.array.reshape(-1, 3)
    near, far = np.isclose(x[:, 0], x[:, 0].min()), np.isclose(x[:, 0], x[:, 0].max())
    apart = y[far].mean(axis=0) - y[near].mean(axis=0)
    return float(np.linalg.norm(apart) - (x[:, 0].max() - x[:, 0].min()))


def measures(case: Case, scene: Scene, seen: Seen, history: dict[str, Array]) -> dict[str, float]:
    """Return the measures of a finished run, each the size of an error [-]."""
    found = {"energy": float(np.abs(history["guarded_error"]).max())}
    table = seen.table
    if case.base == "spin":
        # over whole periods of the fundamental the mean is the elongation of steady spin
        a, rho, E = 0.05, RHO, 210e9
        exact = 2 * rho * case.spin**2 * a**3 / (3 * E)
        mean = np.trapezoid(table[:, 1], table[:, 0]) / table[-1, 0]
        return found | {"elongation": abs(float(mean) / exact - 1)}
    normal, tangential, depth = table[:, 1], table[:, 2], table[:, 3]
    half = len(table) // 2
    size = scene.mesh.size or 1.0
    found["depth / cell"] = float(depth[half:].max()) / size
    mean = float(normal.mean())
    found["ripple"] = float(normal.std()) / max(mean, 1e-300)
    if not any(contact.damping for contact in scene.contacts.values()):
        # nothing asks for a loss at landings: what is lost or gained the contact does by itself
        work = max(float(history["contact_work"][-1]), 1e-300)
        taken = float(np.abs(table[:, 4]).max()) / work
        found["contact energy"] = found["energy"] + taken
    if case.base == "slide":
        return found | slide(case, scene, seen, table)
    if case.base in ("roll", "drift"):
        found["normal force"] = abs(mean / normal[0] - 1)
        if case.base == "drift":
            share = tangential[-half // 4 :].mean() / (0.3 * normal[-half // 4 :].mean())
            # 5 mrad and more saturate the friction, straight running leaves none
            found["tangential force"] = abs(float(share) - (case.x != "0"))
        return found
    return found | {"pressure": abs(float(np.mean(seen.pressure)) / exact_pressure(scene) - 1)}


def slide(case: Case, scene: Scene, seen: Seen, table: Array) -> dict[str, float]:
    """Return what the block is off by: weight and change of speed, where a closed form holds."""
    if case.panel.startswith("target ends"):
        return {}
    load = -scene.loads[0].traction[2]
    area, friction = 0.02**2, scene.contacts["face"].friction
    thin = case.moved.get("scale", (1.0, 1.0, 1.0))[2]
    slope = float(friction) * load / (RHO * HEIGHT * thin)  # type: ignore[arg-type]
    v = scene.bodies["block"].velocity
    assert v is not None
    speeds = np.array(seen.speeds)[:, 0]
    t, speeds = table[:, 0], np.array(seen.speeds)[:, 0]
    way, exact = speeds[0] - speeds, np.minimum(v[0], slope * t)
    lost, loss = float(way[-1]), float(exact[-1])
    if loss == v[0]:  # a block that has stopped rings about rest
        late = slice(-len(t) // 4, None)
        lost, loss = float(way[late].mean()), float(exact[late].mean())
    scale = loss or v[0] or slope * t[-1] or SPEED
    return {
        "normal force": abs(float(table[:, 1].mean()) / (load * area) - 1),
        "change of speed": abs(lost - loss) / scale,
    }


def exact_pressure(scene: Scene) -> float:
    """Return Hertz's pressure of a pressed case [Pa]."""
    body, mesh = next(iter(scene.bodies.values())).material, scene.mesh
    assert isinstance(body, Isotropic)
    stiff = body.youngs_modulus / (2 * (1 - body.poisson_ratio**2))
    traction = -scene.loads[0].traction[2]
    if isinstance(mesh, CapMesh):
        return hertz_sphere(4 * traction * mesh.extent**2, mesh.radius, stiff).p0
    assert isinstance(mesh, CurvedMesh) and mesh.radius is not None
    return hertz_line(2 * traction * mesh.x[1], mesh.radius, stiff).p0


def judge(case: Case) -> Verdict:
    """Run a case and return its verdict."""
    began, seen = time.perf_counter(), Seen(case)

    def verdict(kind: str, message: str, found: dict[str, float]) -> Verdict:
        over = {k: v / TOLERANCES[k] for k, v in found.items()}
        worst = max(over, key=lambda k: over[k]) if over else ""
        model = seen.model
        steps, share = (model.state.step, model.dt / model.dt_bound) if model else (0, 0.0)
        if not kind:
            kind = "wrong" if over[worst] > 1 else "accurate"
        value, seconds = found.get(worst, 0.0), time.perf_counter() - began
        return Verdict(kind, worst, value, message, steps, share, seconds, found)

    with tempfile.TemporaryDirectory() as scratch:
        try:
            scene = scene_of(case, Path(scratch))
            history = run(scene, Path(scratch) / "out", watch=seen, quiet=True).history
        except SceneError as error:
            return verdict("refused", str(error), {})
        except GuardError as error:
            return verdict("caught", str(error), {})
        except Exception as error:  # what no guard has turned into a message is the defect sought
            return verdict("unseen", f"{type(error).__name__}: {error}", {})
    found = measures(case, scene, seen, history)
    if wild := went_wild(history):
        return verdict("unseen", wild, found)
    kind, message = of_the_model(case, scene, found)
    return verdict(kind, message, found)


def of_the_model(case: Case, scene: Scene, found: dict[str, float]) -> tuple[str, str]:
    """Return ``model`` if a case is off for an instability of its model, and what was seen of it.

    Only a block on a base whose force swings and grows though energy is balanced is run again.
    """
    swings = found.get("ripple", 0.0) > TOLERANCES["ripple"]
    balanced = found["energy"] <= TOLERANCES["energy"]
    if case.base != "slide" or case.moved or not (swings and balanced):
        return "", ""
    friction = scene.contacts["face"].friction
    if not (isinstance(friction, float) and friction > 0):
        return "", ""
    unstable, message = growth.itself(scene, "face")
    return "model" if unstable else "", message


def went_wild(history: dict[str, Array]) -> str:
    """Return what shows that a finished run had blown up, empty if nothing does."""
    stored = history["internal"] + history["hourglass"] + history["contact"] + history["spring"]
    have = np.abs(history["kinetic"]) + stored
    given = have[0] + np.abs(history["external_work"]).max()
    if not np.isfinite(have).all():
        return "energies are not finite"
    grown = float(have.max() / max(given, 1e-300))
    return f"energy has grown {grown:.1f} times" if grown > WILD else ""


def row(case: Case, verdict: Verdict) -> dict[str, Any]:
    """Return case and verdict as a flat row for the file of results."""
    told = asdict(verdict)
    return {"key": case.key, "panel": case.panel, "x": case.x, "y": case.y, **told}


WORKERS = 2
SLOW = ("roll", "drift", "load")  # bases of thousands of cells
KINDS = ("accurate", "model", "wrong", "refused", "caught", "unseen")
COLUMNS = (
    "panel",
    "x",
    "y",
    "kind",
    "measure",
    "value",
    "steps",
    "step_over_bound",
    "seconds",
    "message",
)


def matrix(
    out: Path, *, quick: bool = False, workers: int = WORKERS, log: Callable[[str], Any]
) -> list[dict[str, Any]]:
    """Run all cases that the folder has no verdict of yet; return the rows of all.

    Every verdict is written to ``cells.jsonl`` as it comes; ``cells.csv`` holds them in order.

    Args:
        out: Folder, made if missing.
        quick: A part of the cases.
        workers: Processes.
        log: Called with a line of progress.
    """
    out.mkdir(parents=True, exist_ok=True)
    file = out / "cells.jsonl"
    known = {r["key"]: r for r in read(file)}
    wanted = cases(quick)
    due = [case for case in wanted if case.key not in known]
    due.sort(key=lambda case: case.base in SLOW)  # most verdicts first
    log(f"{len(wanted)} cells, {len(wanted) - len(due)} of them known")
    began = time.perf_counter()
    with file.open("a", encoding="utf-8") as keep:
        for done, one in enumerate(judged(due, workers), 1):
            keep.write(json.dumps(one) + "\n")
            keep.flush()
            known[one["key"]] = one
            left = (time.perf_counter() - began) / done * (len(due) - done)
            value = f" {one['measure']} {one['value']:.2g}" if one["measure"] else ""
            log(f"{done}/{len(due)}, {left:.0f} s left: {one['key']}: {one['kind']}{value}")
    rows = [known[case.key] for case in wanted]
    with (out / "cells.csv").open("w", encoding="utf-8", newline="") as table:
        writer = csv.DictWriter(table, COLUMNS, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)
    return rows


def judged(due: Iterable[Case], workers: int) -> Iterator[dict[str, Any]]:
    """Yield the rows of cases as they are done; in this process with one worker."""
    if workers == 1:
        yield from map(judged_row, due)
        return
    os.environ |= OWN_MODULES  # for the workers: a pool takes no environment of theirs
    # MPI does not survive a fork, so workers start afresh
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=spawn) as pool:
        for future in as_completed([pool.submit(judged_row, case) for case in due]):
            yield future.result()


def judged_row(case: Case) -> dict[str, Any]:
    """Return the row of a case after running it."""
    return row(case, judge(case))


def read(file: Path) -> list[dict[str, Any]]:
    """Return the rows of a file of verdicts; a line cut short by a stop is left out."""
    rows = []
    for line in file.read_text("utf-8").splitlines() if file.is_file() else ():
        try:
            rows.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return rows


def counts(rows: Iterable[dict[str, Any]]) -> dict[str, int]:
    """Return how many cells got each verdict."""
    kinds = [r["kind"] for r in rows]
    return {kind: kinds.count(kind) for kind in KINDS}
