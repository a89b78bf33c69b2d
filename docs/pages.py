# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pages that are made of the code: scenes, scene keys, command line.

They are written below docs/made/ at every build, so that they cannot fall behind.
"""

import re
import tomllib
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import typer

from workflow.cli.main import app
from workflow.scene.reference import Key, keys, toml
from workflow.scene.scene import BUILTIN, Scene, names
from workflow.scene.steels import STEELS

HERE = Path(__file__).parent
FACES = ("workflow", "contact", "contact.theory", "forms", "meshes", "meshes.profiles")
ORDER = (
    "bar- two-bars sliding stick slip contact hertz ball sphere cattaneo carter kalker tread flange"
)


def write(folder: Path) -> None:
    """Write all pages, only those that change."""
    notes = tomllib.loads((HERE / "scenes.toml").read_text("utf-8"))
    pages = {f"scenes/{name}.md": scene(name, notes[name]) for name in names()}
    pages["scenes/index.md"] = gallery(notes)
    pages["keys.md"] = reference()
    pages["command-line.md"] = commands()
    pages["python.md"] = python()
    pages["steels.md"] = steels()
    for name, text in pages.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.is_file() or path.read_text("utf-8") != text:
            path.write_text(text, "utf-8")


def ordered() -> list[str]:
    """Return the built-in scenes from bars to wheels."""
    first = ORDER.split()
    return sorted(names(), key=lambda n: next((i for i, w in enumerate(first) if w in n), 99))


def gallery(notes: dict[str, Any]) -> str:
    """Return the page of all scenes."""
    lines = [
        "# Scenes",
        "",
        "| scene | what it shows | answer | size and time |",
        "|---|---|---|---|",
    ]
    for name in ordered():
        told = Scene.load(name)
        lines.append(
            f"| [`{name}`]({name}.md) | {told.title} | {notes[name]['answer']} | {told.about} |"
        )
    toc = ["", "```{toctree}", ":hidden:", "", *ordered(), "```", ""]
    return "\n".join([*lines, "", "Times are on two quiet cores.", *toc])


def scene(name: str, note: dict[str, Any]) -> str:
    """Return the page of a built-in scene."""
    told, text = Scene.load(name), (BUILTIN / f"{name}.toml").read_text("utf-8")
    head = re.match(r"(?:#.*\n)+", text)
    said = [line.lstrip("# ") for line in (head[0] if head else "").splitlines()[1:]]
    lines = [f"# {name}", "", f"**{told.title}**: {told.about}.", "", *said, ""]
    if picture := note.get("picture"):
        lines += [f"![{told.title}](../../../pictures/{picture})", ""]
    lines += ["## What it is held against", "", note["answer"], ""]
    lines += [*note.get("measured", "").splitlines(), "", "## Run it", ""]
    lines += [f"    squealx run {name}", f"    squealx report runs/{name}", ""]
    lines += ["## What to change", "", "| change | why |", "|---|---|"]
    lines += [f"| `--set {k}={toml(v)}` | {why} |" for k, (v, why) in note["set"].items()]
    lines += ["", f"Or write one of your own: `squealx new mine --from {name}`.", ""]
    return "\n".join([*lines, "## The scene file", "", "```toml", text.rstrip(), "```", ""])


def reference() -> str:
    """Return the page of all keys of a scene, a table of keys for each of its tables."""
    lines = [
        "# Scene keys",
        "",
        "All numbers are in SI units. `NAME` stands for a name of your choice, `[]` for one of",
        "a list; a file may also have `base`, the scene it starts from. The same in a terminal:",
        "`squealx keys contacts.friction`; in an editor: `squealx schema`. Sizes are at most 1e18.",
    ]
    tables: dict[tuple[str, str], list[Key]] = {}
    for key in keys():
        tables.setdefault((key.path.rpartition(".")[0], key.where), []).append(key)
    for (table, where), rows in tables.items():
        lines += [
            "",
            f"## {f'`{table}`' if table else 'Top level'}{f', {where}' if where else ''}",
            "",
        ]
        lines += [
            "| key | type | default | range | what it is | example |",
            "|---|---|---|---|---|---|",
        ]
        lines += [f"| {' | '.join(_cells(key))} |" for key in rows]
    return "\n".join([*lines, ""])


def steels() -> str:
    """Return the page of the grades of steel that a scene may name."""
    lines = ["# Steels", "", import_module("workflow.scene.steels").__doc__ or "", ""]
    lines += [
        '`material = { steel = "R260" }`, any constant beside it in place of the grade\'s.',
        "",
    ]
    lines += [
        "| grade | yield stress | tensile strength | source | confidence |",
        "|---|---|---|---|---|",
    ]
    for name, steel in STEELS.items():
        strength = " to ".join(f"{stress / 1e6:.0f}" for stress in steel.tensile_strength)
        least = "at least " * (len(steel.tensile_strength) == 1)
        lines.append(
            f"| `{name}` | {steel.yield_stress / 1e6:.0f} MPa | {least}{strength} MPa "
            f"| {steel.source} | {steel.confidence} |"
        )
    return "\n".join([*lines, ""])


def _cells(key: Key) -> Iterator[str]:
    """Yield the cells of a key."""
    yield f"`{key.name}`"
    yield f"{key.type} [{key.unit}]" if key.unit else key.type
    yield "*must be given*" if key.default is None else f"`{key.default}`" if key.default else ""
    yield f"`{key.range}`" if key.range.startswith('"') else key.range
    yield key.text
    yield f"`{key.example}`" if key.example else ""


def commands() -> str:
    """Return the page of the command line, from the parser."""
    lines = [
        "# Command line",
        "",
        "Exit codes: **0** done; **2** bad input; **3** stopped by a guard,",
    ]
    lines += ["a full disk or an error on one rank, results kept; **130** interrupted."]
    group: Any = typer.main.get_command(app)
    for name, command in sorted(group.commands.items()):
        arguments = " ".join(p.name.upper() for p in command.params if not _is_option(p))
        lines += ["", f"## `squealx {name}`", "", command.help or "", ""]
        lines += ["```text", f"squealx {name} {arguments}".rstrip() + " [OPTIONS]", "```", ""]
        rows = [(_spelled(p), p.help or "", _default(p)) for p in command.params]
        lines += ["| option | what it is | default |", "|---|---|---|"]
        lines += [f"| `{words}` | {text} | {default} |" for words, text, default in rows]
        shown = re.findall(r"\[dim\](squealx .*?)\[/dim\]", command.epilog or "")
        lines += ["", *(f"    {line}" for line in shown)]
    return "\n".join([*lines, ""])


def python() -> str:
    """Return the page of the public names of each package, which import them when first used."""
    lines = ["# Python API", "", "Names that a package lists may be relied on; others may change."]
    for face in FACES:
        module = import_module(face)
        lines += ["", f"## {face}", "", module.__doc__ or "", "", "```{eval-rst}"]
        for name in module.__all__:
            found = getattr(module, name)
            if not (isinstance(found, type) or callable(found)):
                continue  # a plain value
            kind = "autoclass" if isinstance(found, type) else "autofunction"
            lines += [f".. {kind}:: {face}.{name}"]
            lines += ["   :members:", "   :exclude-members: model_config"] * (kind == "autoclass")
            lines += [""]
        lines += ["```"]
    return "\n".join([*lines, ""])


def _is_option(parameter: Any) -> bool:
    return str(parameter.opts[0]).startswith("-")


def _spelled(parameter: Any) -> str:
    """Return how a parameter is written."""
    if not _is_option(parameter):
        return str(parameter.name).upper()
    value = "" if parameter.is_flag else f" {parameter.metavar or parameter.name.upper()}"
    return f"{parameter.opts[0]}{value}"


def _default(parameter: Any) -> str:
    """Return the default of a parameter, none for flags."""
    found = parameter.default
    plain = isinstance(found, int | float | str | Path) and not isinstance(found, bool)
    return f"`{found}`" if plain and str(found) else ""
