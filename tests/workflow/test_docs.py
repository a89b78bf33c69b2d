# SPDX-License-Identifier: LGPL-3.0-or-later
"""Documentation: it builds, and what it and the README tell to type is accepted."""

import contextlib
import io
import json
import re
import shlex
import subprocess
import sys
import tomllib
from itertools import pairwise
from pathlib import Path

import pytest
import typer

from workflow import Scene
from workflow.cli.main import app
from workflow.scene import reference
from workflow.scene.scene import names

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
PAGES = [page for page in PAGES if "made" not in page.parts]
NOTES = tomllib.loads((ROOT / "docs" / "scenes.toml").read_text("utf-8"))


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text("utf-8"), re.M | re.S)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The documentation, built as ``make docs`` does."""
    out = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "docs", str(out)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return out


@pytest.mark.slow
def test_site_builds_without_network(site):
    """No warning, no dead link inside; styles and scripts are its own."""
    for page in site.rglob("*.html"):
        text = page.read_text("utf-8")
        assert not re.findall(r'<(?:script|link|img)[^>]*(?:src|href)="(?:https?:)?//', text), page


@pytest.mark.slow
def test_site_has_every_key_scene_and_command(site):
    """The page of keys has them all; each scene has a page, each command a heading."""
    text = (ROOT / "docs" / "made" / "keys.md").read_text("utf-8")
    rows = re.findall(r"^\| `(\w+)` \|", text, re.M)
    assert sorted(rows) == sorted(key.name for key in reference.keys())
    assert {page.stem for page in (site / "made" / "scenes").glob("*.html")} == {*names(), "index"}
    commands = (site / "made" / "command-line.html").read_text("utf-8")
    assert all(f"squealx {name}" in commands for name in typer.main.get_command(app).commands)


def test_every_scene_is_told_of():
    """Each built-in scene has an answer and something to change, and takes the change."""
    assert set(NOTES) == set(names())
    for name, note in NOTES.items():
        assert note["answer"] and note["set"]
        for key, (value, why) in note["set"].items():
            assert why and Scene.load(name, **{key: value}) != Scene.load(name), (name, key)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_are_accepted(page):
    """Verbs, options, built-in scenes and keys of every line that begins with squealx."""
    group = typer.main.get_command(app)
    for line in re.findall(r"^ {4}(?:\S*/)?squealx (.*)$", page.read_text("utf-8"), re.M):
        verb, *words = shlex.split(line, comments=True)
        assert verb in group.commands, line
        known = {name for option in group.commands[verb].params for name in option.opts}
        for word, after in pairwise([*words, ""]):
            if word.startswith("--"):
                assert word.split("=")[0] in known, line
            if word == "--set":
                assert reference.find(after.split("=")[0])[0].meant(after.split("=")[0]), line
        if verb in ("run", "mesh", "modes", "audit", "export") and words[0][0] != "-":
            assert words[0] in names() or words[0].endswith(".toml"), line


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_files_that_pages_name_are_there(page):
    """Links to files, relative to the page; those to made pages when they are made."""
    for link in re.findall(r"\]\((?!https?:)([^)#]+)\)", page.read_text("utf-8")):
        if "made/" not in link:
            assert (page.parent / link).exists(), link


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_scenes_in_pages_are_toml(page):
    """What a page tells to write into a scene can be read."""
    for text in blocks(page, "toml"):
        tomllib.loads(text)


@pytest.mark.parametrize(
    "page", [p for p in PAGES if p.parent.name == "how-to"], ids=lambda p: p.stem
)
def test_code_of_how_to_pages_runs(page):
    """As it stands, on its own; a law is tried on numbers."""
    for text in blocks(page, "python"):
        space: dict = {}
        exec(compile(text, page.name, "exec"), space)
        if page.stem == "own-friction-law":
            assert space["law"](0.0, 1e6, None) == pytest.approx(0.4)


def test_readme_snippet_prints_what_it_says(tmp_path, monkeypatch):
    """The run of a bar against a wall: the numbers that the text below it quotes."""
    monkeypatch.chdir(tmp_path)
    text, out = (ROOT / "README.md").read_text("utf-8"), io.StringIO()
    (code,) = blocks(ROOT / "README.md", "python")
    with contextlib.redirect_stdout(out):
        exec(compile(code, "README.md", "exec"), {})
    for line in out.getvalue().strip().splitlines():
        assert f"`{line}`" in re.sub(r"\s+", " ", text)
    assert code in blocks(ROOT / "docs" / "getting-started.md", "python")


def test_versions_agree():
    """Package, citation and metadata tell the same version."""
    version = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["version"]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text("utf-8")
    assert json.loads((ROOT / "codemeta.json").read_text("utf-8"))["version"] == version
