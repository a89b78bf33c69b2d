# SPDX-License-Identifier: LGPL-3.0-or-later
"""Study: many runs of one or several scenes as a checked table of parameters."""

import hashlib
import itertools
import math
import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from workflow.scene import keys
from workflow.scene.mesh import FILES
from workflow.scene.scene import Scene, SceneError, beside
from workflow.scene.scene import read as read_scene
from workflow.scene.units import LONGEST_NAME, Count, Name, Section, explain

MOST_RUNS = 10_000
OWN = ("scene", "ranks")  # keys of a run that are not keys of its scene


class Row(BaseModel):
    """A run of the table ``[[runs]]``: the keys of the scene that it changes, and its name."""

    model_config = ConfigDict(extra="allow", frozen=True)

    name: str | None = None
    scene: str | None = None
    ranks: Count | None = None


class Group(Section):
    """Runs that are compared with each other: each of ``runs`` at every point of ``vary``.

    ``set`` changes keys of the scene in all of them, ``vary`` gives a list of values by key.
    """

    name: str
    scene: str | None = None
    ranks: Count | None = None
    set: dict[str, Any] = Field(default_factory=dict)
    runs: list[Row] = Field(default_factory=list)
    vary: dict[str, Any] = Field(default_factory=dict)


class Study(Section):
    """A whole study: one group of runs, or several ``groups`` that share ``scene`` and ``set``."""

    name: Name
    title: str
    about: str = ""
    scene: str | None = None
    ranks: Count = 1
    set: dict[str, Any] = Field(default_factory=dict)
    runs: list[Row] = Field(default_factory=list)
    vary: dict[str, Any] = Field(default_factory=dict)
    groups: list[Group] = Field(default_factory=list)
    figures: bool = True
    compare: list[Literal["shear_of_patches", "convergence", "error_against_time"]] = Field(
        default_factory=list
    )

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if not re.fullmatch(r"\w[\w.-]*", self.name):
            raise ValueError(f"name = {self.name!r}: expected letters, digits, '-', '_' and '.'")
        if self.groups and (self.runs or self.vary):
            raise ValueError("groups: expected runs and vary inside the groups, got both")
        if not (self.runs or self.vary or any(part.runs or part.vary for part in self.groups)):
            raise ValueError("runs: missing; expected [[runs]] or [vary] with what to run")
        return self

    @property
    def parts(self) -> list[Group]:
        """The groups, with what they share filled in; one without a name if there are none."""
        if not self.groups:
            own = {key: getattr(self, key) for key in ("scene", "ranks", "set", "runs", "vary")}
            return [Group(name="", **own)]
        return [
            part.model_copy(
                update={
                    "scene": part.scene or self.scene,
                    "ranks": part.ranks or self.ranks,
                    "set": keys.joined(self.set, part.set),
                }
            )
            for part in self.groups
        ]


@dataclass(frozen=True)
class Run:
    """One run of a study.

    Attributes:
        name: Its own name, also that of its folder.
        group: The group that it belongs to, empty if there is only one.
        label: What tells it from the others of its group.
        scene: What is run.
        ranks: MPI ranks that share it.
        changes: Its parameters: values by dotted key, empty for the scene as it is.
    """

    name: str
    group: str
    label: str
    scene: Scene
    ranks: int
    changes: dict[str, Any]


def names() -> list[str]:
    """Return the names of the built-in studies."""
    folder = resources.files("workflow.study") / "builtin"
    return sorted(p.name[:-5] for p in folder.iterdir() if p.name.endswith(".toml"))


def load(source: str | Path) -> Study:
    """Return the built-in study or TOML file ``source``.

    Scenes and other files are named relative to the TOML file.

    Raises:
        SceneError: naming the key, what it got and what it expects.
    """
    path = Path(source)
    if path.suffix != ".toml" and str(source) in names():
        text = (resources.files("workflow.study") / "builtin" / f"{source}.toml").read_text("utf-8")
    elif path.is_file():
        text = path.read_text("utf-8")
    else:
        raise SceneError(f"study {str(source)!r}: expected a TOML file or one of {names()}")
    try:
        tables = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SceneError(f"{source}: not valid TOML: {error}") from None
    for above, table in _tables(tables):
        for key, value in table.items():
            if key == "scene":
                table[key] = _beside(path.parent, value)
            elif key in FILES or f"{above}.{key}" in FILES:
                table[key] = beside(path.parent.absolute(), value)
    try:
        return Study.model_validate(tables)
    except ValidationError as error:
        raise SceneError("\n".join(explain(e, tables, Study) for e in error.errors())) from None


def runs_of(study: Study, changes: Mapping[str, Any] | None = None) -> list[Run]:
    """Return the runs of a study, every scene checked, without heavy work.

    Args:
        study: The study.
        changes: Values by dotted key that hold in every run, whatever ``set`` says.

    Raises:
        SceneError: a line for every run whose scene cannot be run.
    """
    found, wrong = [], []
    for part in study.parts:
        _check_size(part)
        for label, row in _points(part):
            name = _slug("_".join(filter(None, (part.name, label))))
            if both := [key for key in row if key in (changes or {})]:
                raise SceneError(f"--set {both[0]}: expected a key that the study does not vary")
            try:
                found.append(_run(name, label, part, row, dict(changes or {})))
            except SceneError as error:
                wrong += [f"run {name}: {line}" for line in str(error).splitlines()]
    count = [run.name for run in found]
    wrong += [f"run {n}: expected one of this name" for n in sorted({*count}) if count.count(n) > 1]
    if wrong:
        raise SceneError("\n".join(wrong))
    return found


def _check_size(part: Group) -> None:
    """Raise SceneError for a group of more runs than anybody waits for, before one is listed."""
    grid = {key: len(v) for key, v in keys.flat(part.vary) if isinstance(v, list)}
    count = math.prod(grid.values()) * max(1, len(part.runs))
    if count > MOST_RUNS:
        times = " times ".join(f"{n} of {key}" for key, n in grid.items())
        where = f"groups.{part.name}.vary" if part.name else "vary"
        rows = f", with {len(part.runs)} rows of runs" * bool(part.runs)
        raise SceneError(f"{where}: {count:.3g} runs ({times}{rows}); expected at most {MOST_RUNS}")


def _run(name: str, label: str, part: Group, row: dict[str, Any], over: dict[str, Any]) -> Run:
    """Return a run with its scene checked."""
    from workflow.model.checks import check  # a list of studies needs no meshing

    ranks, source = row.get("ranks", part.ranks), row.get("scene", part.scene)
    if not isinstance(source, str):
        raise SceneError("scene: missing; expected a built-in scene or a TOML file")
    if not isinstance(ranks, int) or isinstance(ranks, bool) or ranks < 1:
        raise SceneError(f"ranks = {ranks!r}: expected an integer, at least 1")
    own = keys.nested({key: value for key, value in row.items() if key not in OWN})
    tables = read_scene(source)
    for changes in (keys.nested(part.set), own, keys.nested(over)):
        tables = keys.joined(tables, changes)
    scene = Scene.check(tables)
    check(scene)
    return Run(name, part.name, label, scene, ranks, row)


def _points(part: Group) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield a label and the changed keys of every run of a group."""
    grid = dict(keys.flat(part.vary))
    for key, values in grid.items():
        if not (isinstance(values, list) and values):
            raise SceneError(f"vary.{key} = {values!r}: expected a list of values")
    for number, row in enumerate(part.runs or [Row()], 1):
        own = {key: getattr(row, key) for key in OWN if getattr(row, key) is not None}
        own |= dict(keys.flat(row.model_extra or {}))
        for values in itertools.product(*grid.values()):
            point = dict(zip(grid, values, strict=True))
            if both := [key for key in point if key in own]:
                raise SceneError(f"vary.{both[0]}: expected a key that no row of runs sets")
            told = point if row.name else own | point
            label = "_".join(filter(None, (row.name, *_words(told))))
            yield label or f"run-{number}", own | point


def _words(point: Mapping[str, Any]) -> list[str]:
    """Return ``key=value`` for each parameter, keys by their last word if that is enough."""
    last = [key.rsplit(".", 1)[-1] for key in point]
    keys = last if len(set(last)) == len(last) else list(point)
    values = [
        Path(v).stem if k == "scene" else _told(Path(str(v)).name if k in FILES else v)
        for k, v in point.items()
    ]
    return [f"{key}={value}" for key, value in zip(keys, values, strict=True)]


def _told(value: Any) -> str:
    if isinstance(value, Mapping):
        return ",".join(_told(entry) for entry in value.values())
    return ",".join(map(_told, value)) if isinstance(value, list) else str(value)


def _slug(name: str) -> str:
    """Return a name that is safe as that of a folder, in a shell and in a pattern."""
    safe = re.sub(r"[^\w.=,+-]+", "-", name).strip("-.") or "run"
    if len(safe.encode()) <= LONGEST_NAME:
        return safe
    short = safe.encode()[: LONGEST_NAME - 9].decode(errors="ignore")
    return f"{short}-{hashlib.sha256(safe.encode()).hexdigest()[:8]}"


def _tables(value: Any, above: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield a table and all below it, each with its name."""
    if isinstance(value, dict):
        yield above, value
    for name, inner in value.items() if isinstance(value, dict) else enumerate(value):
        if isinstance(inner, dict | list):
            yield from _tables(inner, str(name))


def _beside(folder: Path, scene: Any) -> Any:
    """Return the path of a scene file named relative to a folder; names stay."""
    if isinstance(scene, list):
        return [_beside(folder, entry) for entry in scene]
    path = isinstance(scene, str) and scene.endswith(".toml")
    return str((folder / scene).absolute()) if path else scene
