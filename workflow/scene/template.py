# SPDX-License-Identifier: LGPL-3.0-or-later
"""Commented scene of one's own: a built-in one with the keys that it leaves out and their meaning.

Text and comments of the built-in scene stay. Below the keys of a table stand, commented out, those
with a default, with unit and text. Editors complete and check with the schema beside the file.
"""

import json
import re
import shutil
import textwrap
import tomllib
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

from workflow.scene.keys import flat
from workflow.scene.mesh import FILES
from workflow.scene.reference import Key, keys
from workflow.scene.scene import BUILTIN, Scene, names
from workflow.scene.schema import SHIPPED, schema
from workflow.scene.units import SceneError, folder_name

SCHEMA = "squealx.schema.json"  # beside a scene of one's own
FROM_BUILTIN = f"#:schema ../{SHIPPED.name}\n"  # the first line of every built-in scene
HEADER = re.compile(r"^\[\[?([^\]]+)\]\]?", re.MULTILINE)
WIDTH = 100


def new(file: Path, source: str) -> list[Path]:
    """Write a scene of one's own, named as its file; return what was written.

    Args:
        file: TOML file to write; its suffix may be left out.
        source: Built-in scene to start from.

    Raises:
        SceneError: if there is no such scene, the name is none, or the file is there.
    """
    if source not in names():
        raise SceneError(f"--from {source!r}: expected one of {', '.join(names())}")
    file = file if file.suffix == ".toml" else file.with_name(f"{file.name}.toml")
    try:
        text = template(source, folder_name(file.stem))
    except ValueError as error:
        raise SceneError(str(error)) from None
    try:
        with file.open("x", encoding="utf-8") as stream:
            stream.write(text)
    except FileExistsError:
        raise SceneError(f"{file}: expected a new file, this one is there") from None
    except (FileNotFoundError, NotADirectoryError):
        raise SceneError(f"{file}: expected a folder that is there") from None
    (file.parent / SCHEMA).write_text(json.dumps(schema(), indent=1) + "\n", "utf-8")
    copied = list(_copied(text, file.parent))
    Scene.load(file)
    return [file, file.parent / SCHEMA, *copied]


def template(source: str, name: str) -> str:
    """Return the text of a built-in scene under another name, with all keys of its tables."""
    text = (BUILTIN / f"{source}.toml").read_text("utf-8").removeprefix(FROM_BUILTIN)
    text = re.sub(r'^name = ".*"$', f'name = "{name}"', text, count=1, flags=re.MULTILINE)
    tables = tomllib.loads(text)
    if "base" not in tables:  # what the base says is not known here
        text = "\n".join([*_tables(text, tables), *_absent(tables)]) + "\n"
    return f"#:schema ./{SCHEMA}\n# From {source}. What a key means: squealx keys KEY\n{text}"


def _tables(text: str, tables: dict[str, Any]) -> Iterator[str]:
    """Yield the text table by table, each with the keys that it leaves out."""
    starts = [0, *(match.start() for match in HEADER.finditer(text)), len(text)]
    seen = set[str]()
    for start, end in pairwise(starts):
        lines = text[start:end].rstrip("\n").split("\n")
        said = max(i for i, line in enumerate(lines) if line and line[0] != "#") + 1
        header = HEADER.match(text[start:end])
        own = tomllib.loads("\n".join(lines[1:] if header else lines))
        path = header.group(1) if header else ""
        left_out = [
            key
            for key in keys()
            if _child_of(key, path, own, tables) and key.name not in own and key.path not in seen
        ]
        seen.update(key.path for key in left_out)
        yield from (*lines[:said], *(line for key in left_out for line in _commented(key)))
        yield from (*lines[said:], "")


def _child_of(key: Key, path: str, own: dict[str, Any], tables: dict[str, Any]) -> bool:
    """Tell whether a key with a default stands in the table at ``path`` of these tables."""
    child = f"{path}.{key.name}" if path else key.path
    if key.default is None or "table" in key.type.split(" or ")[0] or not key.meant(child):
        return False
    if not path and "." in key.path:
        return False
    condition = tomllib.loads(key.where)
    above, holders = tables, [own]
    for part in path.split("."):
        above = above.get(part, {}) if isinstance(above, dict) else {}
        holders.append(above if isinstance(above, dict) else {})
    return not condition or any(condition.items() <= dict(flat(held)).items() for held in holders)


def _absent(tables: dict[str, Any]) -> Iterator[str]:
    """Yield a line for every table of a scene that this one does not have."""
    yield "# Tables that may be added:"
    for key in keys():
        if "." not in key.path and "table" in key.type and key.path not in tables:
            heads = {"table": "[{}]", "list of tables": "[[{}]]"}
            head = heads.get(key.type, "[{}.NAME]").format(key.path)
            yield f"# {head:<17} {key.text}"


def _commented(key: Key) -> Iterator[str]:
    """Yield a key with its default, or else an example, commented out, with unit and text."""
    value = f"# {key.name} = {key.default or key.example}"
    text = f"{key.unit}: {key.text}" if key.unit not in ("", "-") else key.text
    text += f" One of {key.range}." if key.type == "choice" else ""
    if len(line := f"{value:<30}   # {text}") <= WIDTH:
        yield line
    else:
        yield from (f"# {line}" for line in textwrap.wrap(text, WIDTH - 2))
        yield value


def _copied(text: str, folder: Path) -> Iterator[Path]:
    """Yield the files that a built-in scene names, copied into a folder that has none such."""
    mesh = tomllib.loads(text).get("mesh", {})
    for key in FILES:
        name = mesh.get(key.removeprefix("mesh."))
        if isinstance(name, str) and (BUILTIN / name).is_file() and not (folder / name).exists():
            yield Path(shutil.copyfile(BUILTIN / name, folder / name))
