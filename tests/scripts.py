# SPDX-License-Identifier: LGPL-3.0-or-later
"""Examples run as scripts in this process, and what they print."""

import contextlib
import io
import re
import runpy
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import workflow

EXAMPLES = Path(__file__).parents[1] / "examples"


def printed(name: str, *words: object, run: Callable[..., Any] | None = None) -> str:
    """What an example prints, run as a script; in this process, which has its imports already.

    Args:
        name: Its file.
        words: Its arguments.
        run: Takes the place of ``workflow.run``, so that a test may measure the very run that the
            example makes, instead of making it again.
    """
    out = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(out):
        patch.setattr(sys, "argv", [str(EXAMPLES / name), *map(str, words)])
        if run is not None:
            patch.setattr(workflow, "run", run)
        runpy.run_path(sys.argv[0], run_name="__main__")
    return out.getvalue()


def measured(name: str, *words: object, by: Callable[..., Any]) -> tuple[str, Any]:
    """What an example prints, and what ``by(scene, folder, watch)`` found in the run it makes.

    Args:
        name: Its file.
        words: Its arguments.
        by: Makes the run of the scene into the folder, lets ``watch(model)`` see every step as the
            example asks, and returns what it found.
    """
    found = []

    def run(scene: Any, folder: Path, *, watch: Callable[[Any], Any], quiet: bool) -> None:
        found.append(by(scene, folder, watch))

    text = printed(name, *words, run=run)
    assert len(found) == 1
    return text, found[0]


def numbers(text: str, start: str) -> list[float]:
    """The numbers on the line of a text that begins with a word."""
    line = next(line for line in text.splitlines() if line.startswith(start))
    return [float(word) for word in re.findall(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?", line)]
