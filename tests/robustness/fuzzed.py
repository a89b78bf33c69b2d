# SPDX-License-Identifier: LGPL-3.0-or-later
"""Damage of every kind, generated from a seed: scenes, words, files; and the command line over it.

The command runs in a child forked from a process that has imported what verbs import, so that a
case takes as long as its work.
"""

import os
import random
import re
import shutil
import signal
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import resources
from itertools import islice
from pathlib import Path

ALLOWED = (0, 2, 3, 130)
LONGEST = 60.0  # s of a case
MOST = 4000  # characters of a message
SMALL = ("bar-wave", "bar-impact", "two-bars", "sliding-block", "stick-slip", "contact-patch")
STRANGE = (
    *("0", "-1", "1e-300", "-1e308", "nan", "inf", "1e999", "true", "[]", "{}", '""', "'x'", "1.5"),
    *(
        "[1, 2, 3]",
        "[[1.0]]",
        "{ a = 1 }",
        "'../../x'",
        "'[red]x[/]'",
        "'a/b'",
        "1979-05-27",
        "0x1f",
    ),
    *("1" + "0" * 400, "'" + "x" * 5000 + "'", '"\\u0000"', '"é\\u2603"', "[" * 50 + "]" * 50),
)


@dataclass(frozen=True)
class Case:
    """Words for the command line, and how it came to them."""

    words: tuple[str, ...]
    about: str


@dataclass(frozen=True)
class Outcome:
    """What became of a case: ``code`` is -1 for a hang."""

    case: Case
    code: int
    said: str
    seconds: float

    @property
    def fault(self) -> str | None:
        """What is wrong with it, None if nothing is."""
        if self.code == -1:
            return f"hangs for {LONGEST:.0f} s"
        if "Traceback" in self.said or "Fatal Python error" in self.said:
            return "traceback"
        if "nobody expected this" in self.said and "bytes" not in self.case.about:
            return "unexpected error"  # bytes changed at random inside an array look like numbers
        if self.code not in ALLOWED:
            return f"exit code {self.code}"
        if len(self.said) > MOST and self.code:
            return f"message of {len(self.said)} characters"
        return None


def cases(seed: int, folder: Path, finished: Path) -> Iterator[Case]:
    """Yield damage without end: every kind in turn.

    Args:
        seed: Of the random numbers.
        folder: Where damaged files are put.
        finished: Folder of a finished run with a checkpoint, to damage copies of.
    """
    rng = random.Random(seed)
    kinds = (scene_file, changed_key, words, scene_file, result_folder, profile, mesh_file)
    number = 0
    while True:
        place = folder / str(number)
        place.mkdir()
        yield kinds[number % len(kinds)](rng, place, finished)
        number += 1


def scene_file(rng: random.Random, place: Path, _: Path) -> Case:
    """A scene's TOML with one to three lines or bytes changed."""
    name = rng.choice(SMALL)
    text = (resources.files("workflow.scene") / "builtin" / f"{name}.toml").read_text("utf-8")
    about = []
    for _ in range(rng.randint(1, 3)):
        damage = rng.choice((_value, _value, _value, _drop, _twice, _rename, _cut, _noise))
        text = damage(rng, text)
        about.append(damage.__name__)
    path = place / rng.choice(("scene.toml", "a b.toml", "[red].toml", "ä.toml"))
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    verb = rng.choice(("validate", "validate", "validate", "audit", "mesh"))
    out = ("--out", str(place / "out")) if verb == "mesh" else ()
    return Case((verb, str(path), *out), f"{name} {' '.join(about)}")


def _lines(text: str) -> tuple[list[str], list[int]]:
    lines = text.splitlines()
    return lines, [k for k, line in enumerate(lines) if re.match(r"\s*\w+\s*=", line)]


def _value(rng: random.Random, text: str) -> str:
    lines, keys = _lines(text)
    if not keys:
        return text
    k = rng.choice(keys)
    lines[k] = f"{lines[k].split('=')[0]}= {rng.choice(STRANGE)}"
    return "\n".join(lines)


def _drop(rng: random.Random, text: str) -> str:
    lines = text.splitlines()
    del lines[rng.randrange(len(lines))]
    return "\n".join(lines)


def _twice(rng: random.Random, text: str) -> str:
    lines = text.splitlines()
    lines.insert(rng.randrange(len(lines)), rng.choice(lines))
    return "\n".join(lines)


def _rename(rng: random.Random, text: str) -> str:
    lines, keys = _lines(text)
    if not keys:
        return text
    k = rng.choice(keys)
    lines[k] = rng.choice(("x", "[red]", '"a.b"', "mesh", "")) + lines[k].lstrip()
    return "\n".join(lines)


def _cut(rng: random.Random, text: str) -> str:
    return text[: rng.randrange(len(text) + 1)]


def _noise(rng: random.Random, text: str) -> str:
    at = rng.randrange(len(text) + 1)
    return text[:at] + rng.choice(("\0", "\udcff", "]", '"', "'''", "=", "\x1b[31m")) + text[at:]


def changed_key(rng: random.Random, place: Path, _: Path) -> Case:
    """A key of a scene set on the command line, known or not."""
    name = rng.choice((*SMALL, "hertz", "flange-transition", "carter", "steady-curving"))
    text = (resources.files("workflow.scene") / "builtin" / f"{name}.toml").read_text("utf-8")
    key = rng.choice(list(_keys(tomllib.loads(text))))
    key = rng.choice((key, key, key, f"{key}.x", key.split(".")[0], f"{key}s", "", "[b]"))
    changes = (f"{key}={rng.choice(STRANGE)}",)
    return Case(("validate", name, "--set", *changes), f"{name} {key}")


def _keys(tables: dict, above: str = "") -> Iterator[str]:
    for key, value in tables.items():
        if isinstance(value, dict):
            yield from _keys(value, f"{above}{key}.")
        else:
            yield f"{above}{key}"


VERBS = (
    *("run", "validate", "audit", "export", "mesh", "modes", "figures", "report", "study"),
    *("scaling", "stability", "profile", "export-footprints", "scenes", "studies", "version"),
)


def words(rng: random.Random, place: Path, _: Path) -> Case:
    """A verb with arguments and options that make no sense."""
    odd = ("", "no-such", "../x", str(place), "/dev/null", "-1", "[red]", "x" * 3000, "é", "--")
    options = (
        "--ranks",
        "--set",
        "--out",
        "--json",
        "--to",
        "--parts",
        "--cores",
        "--resume",
        "-x",
    )
    found = [rng.choice(VERBS)]
    for _ in range(rng.randint(1, 3)):
        found.append(rng.choice((*odd, *options)))
        if found[-1].startswith("--") and rng.random() < 0.8:
            found.append(rng.choice(odd))
    if found[0] in ("scaling", "stability"):
        found.append("--no-such-option")  # work for minutes, if nothing is wrong
    return Case(tuple(found), "words")


def result_folder(rng: random.Random, place: Path, finished: Path) -> Case:
    """A file of a finished run cut, changed, emptied or gone."""
    folder = place / "run"
    shutil.copytree(finished, folder)
    path = rng.choice(sorted(p for p in folder.rglob("*") if p.is_file()))
    data = bytearray(path.read_bytes())
    damage = rng.choice(("cut", "bytes", "empty", "gone", "folder", "text"))
    if damage == "cut":
        path.write_bytes(data[: rng.randrange(len(data) + 1)])
    elif damage == "bytes":
        for _ in range(20):
            if data:
                data[rng.randrange(len(data))] = rng.randrange(256)
        path.write_bytes(data)
    elif damage in ("empty", "text"):
        path.write_bytes(b"" if damage == "empty" else b"not what it was\n" * 100)
    else:
        path.unlink()
        if damage == "folder":
            path.mkdir()
    verb = rng.choice(("figures", "report", "run"))
    target = ("--resume", "--set", "time.end=3e-5", "--out") if verb == "run" else ()
    return Case((verb, *target, str(folder)), f"{path.relative_to(folder)} {damage}")


def profile(rng: random.Random, place: Path, _: Path) -> Case:
    """A profile of two columns, damaged."""
    line = [(0.001 * y, -0.5 * (0.001 * y) ** 2 / 0.3) for y in range(-35, 36)]
    kind = rng.choice(("ok", "noise", "one", "swap", "nan", "text", "bytes", "huge", "same"))
    if kind == "one":
        line = line[:1]
    elif kind == "swap":
        rng.shuffle(line)
    elif kind == "huge":
        line = [(1e300 * y, z) for y, z in line]
    elif kind == "same":
        line = [line[0]] * 50
    elif kind == "noise":
        line = [(y, z + rng.gauss(0, 1e-4)) for y, z in line]
    rows = [f"{y!r},{z!r}" for y, z in line]
    if kind in ("nan", "text"):
        rows[rng.randrange(len(rows))] = rng.choice(("nan,nan", "a,b", "1,2,3", "inf,0", ";;;"))
    data = "\n".join(rows).encode()
    if kind == "bytes":
        data = bytes(rng.randrange(256) for _ in range(500))
    path = place / rng.choice(("p.csv", "p.ban", "p.whl", "p.prr", "p.txt"))
    path.write_bytes(data)
    key = rng.choice(("mesh.rail_profile", "mesh.wheel_profile"))
    return Case(("validate", "flange-transition", "--set", f"{key}={path}"), f"{kind} {path.name}")


MSH = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
2
2 1 "face"
3 2 "block"
$EndPhysicalNames
$Nodes
8
1 0 0 0
2 1 0 0
3 1 1 0
4 0 1 0
5 0 0 1
6 1 0 1
7 1 1 1
8 0 1 1
$EndNodes
$Elements
2
1 3 2 1 1 1 2 3 4
2 5 2 2 1 1 2 3 4 5 6 7 8
$EndElements
"""
BLOCK = """name = "block"
title = "one cell"
[mesh]
kind = "file"
path = "{path}"
[bodies.block]
regions = ["block"]
material = {{ youngs_modulus = 2e11, poisson_ratio = 0.3, density = 7800.0 }}
[[supports]]
surface = "face"
[time]
end = 1e-5
output_interval = 1e-6
"""


def mesh_file(rng: random.Random, place: Path, _: Path) -> Case:
    """A gmsh file of one cell, damaged, and a scene that reads it."""
    lines = MSH.splitlines()
    kind = rng.choice(("ok", "number", "drop", "twice", "cut", "bytes", "suffix"))
    k = rng.randrange(len(lines))
    if kind == "number":
        parts = lines[k].split()
        parts[rng.randrange(len(parts))] = rng.choice(("-1", "0", "99", "1e99", "nan", "x", "3"))
        lines[k] = " ".join(parts)
    elif kind == "drop":
        del lines[k]
    elif kind == "twice":
        lines.insert(k, lines[k])
    elif kind == "cut":
        lines = lines[:k]
    data = "\n".join(lines).encode() + b"\n"
    if kind == "bytes":
        data = bytes(rng.randrange(256) for _ in range(300))
    mesh = place / ("m.msh" if kind != "suffix" else rng.choice(("m.vtu", "m.inp", "m.xyz", "m")))
    mesh.write_bytes(data)
    (place / "scene.toml").write_text(BLOCK.format(path=mesh.name), encoding="utf-8")
    return Case(("validate", str(place / "scene.toml")), f"mesh {kind}")


def preload() -> None:
    """Import what verbs import, but nothing that starts MPI."""
    import h5py  # noqa: F401
    import matplotlib.pyplot as plt  # noqa: F401
    import meshio  # noqa: F401
    import scipy.optimize
    import scipy.spatial  # noqa: F401

    from workflow.cli import main  # noqa: F401


def outcome(case: Case) -> Outcome:
    """Run the command line over a case in a child and return what became of it."""
    from workflow.cli import main

    with tempfile.TemporaryFile() as said:
        start = time.monotonic()
        child = os.fork()
        if child == 0:
            os.setsid()
            for number in (1, 2):
                os.dup2(said.fileno(), number)
            sys.stdout, sys.stderr = (os.fdopen(os.dup(k), "w", buffering=1) for k in (1, 2))
            sys.argv = ["squealx", *case.words]
            code = 0
            try:
                main()
            except SystemExit as stop:
                code = stop.code if isinstance(stop.code, int) else int(stop.code is not None)
            except BaseException:
                import traceback

                traceback.print_exc()
                code = 1
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
        code = _wait(child, start)
        said.seek(0)
        text = said.read().decode("utf-8", "replace")
    return Outcome(case, code, text, time.monotonic() - start)


def _wait(child: int, start: float) -> int:
    while True:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        if time.monotonic() - start > LONGEST:
            os.killpg(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return -1
        time.sleep(0.005)


def fuzz(count: int, seed: int, finished: Path) -> int:
    """Run so many cases; print each fault and a line of totals; return the number of faults."""
    preload()
    faults, codes = 0, Counter[int]()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        for case in islice(cases(seed, Path(folder), finished), count):
            result = outcome(case)
            codes[result.code] += 1
            if result.fault:
                faults += 1
                words = " ".join(word[:200] for word in case.words)
                print(f"{result.fault}: {case.about}: {words}\n{result.said[-1500:]}", flush=True)
            for made in Path(folder).iterdir():
                shutil.rmtree(made) if made.is_dir() else made.unlink()
    print(f"{count} cases, seed {seed}: exit codes {dict(codes)}, {faults} faults")
    return faults


if __name__ == "__main__":
    sys.exit(fuzz(int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3])) > 0)
