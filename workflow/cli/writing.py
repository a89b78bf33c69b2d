# SPDX-License-Identifier: LGPL-3.0-or-later
"""Verbs of writing a scene: keys, schema, new."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from workflow.cli.options import Json, answer, examples
from workflow.scene.scene import SceneError

verbs = typer.Typer()


@verbs.command(
    epilog=examples(
        "squealx keys contacts.friction",
        "squealx keys mesh.strip",
        "squealx keys damping",
        "squealx keys --json",
    )
)
def keys(
    key: Annotated[
        str | None, typer.Argument(help="Key or table, or a word in either; all if left out.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Explain a key of a scene: type, unit, default, range, what it is, an example."""
    from dataclasses import asdict

    from workflow.scene import reference

    found = list(reference.keys()) if key is None else reference.find(key)
    if not found:
        raise SceneError(f"key {key!r}: expected a key of a scene or a word; see squealx keys")
    every = list(dict.fromkeys([*found, *(b for each in found for b in reference.below(each))]))
    whole = found if key and all(each.meant(key) for each in found) else []

    def lines() -> Iterator[str]:
        for each in every:
            if each in whole:
                yield f"{each.path}\n    {each.text}"
                yield from (f"    {head:<8} {said}" for head, said in each.rows.items())
            else:
                kind = ", ".join(each.rows[head] for head in ("type", "with") if head in each.rows)
                yield f"{each.path} ({kind}): {each.text}"

    answer(as_json, {"keys": [asdict(each) for each in every]}, lines)


@verbs.command(epilog=examples("squealx schema > squealx.schema.json"))
def schema() -> None:
    """Print the JSON Schema of a scene, with which editors complete and check TOML files.

    A scene names it in its first line, as in #:schema ./squealx.schema.json.
    """
    import json

    from workflow.scene.schema import schema as made

    print(json.dumps(made(), indent=1))


@verbs.command(
    epilog=examples("squealx new my-sphere --from hertz", "squealx new scenes/my-curve.toml")
)
def new(
    name: Annotated[str, typer.Argument(help="Name of the scene, or path of its new TOML file.")],
    source: Annotated[
        str, typer.Option("--from", metavar="SCENE", help="Built-in scene to start from.")
    ] = "flange-transition",
    as_json: Json = False,
) -> None:
    """Write a commented scene of one's own: a built-in one, with every key of its tables."""
    from workflow.scene.template import new as write

    written = [str(path) for path in write(Path(name), source)]
    hint = f"change it, then: squealx validate {written[0]}; squealx run {written[0]}"
    answer(as_json, {"files": written}, lambda: [*written, hint])
