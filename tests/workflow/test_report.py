# SPDX-License-Identifier: LGPL-3.0-or-later
"""The page of a run: complete, self-contained, escaped; its checks fail where results are wrong."""

import base64
import json
import shlex
import shutil
import sys
from html.parser import HTMLParser
from pathlib import Path

import h5py
import numpy as np
import pytest
import tomli_w

from workflow import Scene
from workflow.cli import main
from workflow.cli.options import load
from workflow.simulation.guards import GuardError
from workflow.simulation.run import run

pytest.importorskip("matplotlib")
pytest.importorskip("pyvista")
pytest.importorskip("jinja2")

from workflow.report.checks import checks
from workflow.report.page import command, contents, report
from workflow.report.tables import exact, number, settings
from workflow.results.record import Record

SHORT = {"time.end": 8e-6, "time.output_interval": 2e-6, "output.fields": False}
VOID = {"meta", "img", "wbr", "br", "link", "input"}


class Page(HTMLParser):
    """What a page holds: tags and attributes, text, and whether every tag is closed in turn."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict]] = []
        self.open: list[str] = []
        self.words: list[str] = []
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())

    def values(self, *attributes) -> list[str]:
        return [v for _, attrs in self.tags for k, v in attrs.items() if k in attributes and v]


def page_of(folder) -> Page:
    return Page(report(folder).read_text("utf-8"))


@pytest.fixture(scope="module")
def block(tmp_path_factory) -> Path:
    """A block that slides: contact with friction, nothing but history and footprints."""
    folder = tmp_path_factory.mktemp("runs") / "block"
    run(Scene.load("sliding-block", **SHORT), folder, quiet=True)
    return folder


@pytest.fixture
def copied(block, tmp_path) -> Path:
    return Path(shutil.copytree(block, tmp_path / "copy"))


def test_page_holds_all_it_shows(block):
    """Well-formed HTML without scripts or addresses elsewhere; the pictures are those drawn."""
    text = report(block).read_text("utf-8")
    page = Page(text)
    assert not {tag for tag, _ in page.tags} & {"script", "link", "iframe", "object"}
    assert "http" not in text and "@import" not in text and "url(" not in text
    anchors = {attrs["id"] for _, attrs in page.tags if "id" in attrs}
    for address in page.values("href"):
        assert address[0] == "#" and address[1:] in anchors
    sources = page.values("src", "srcset", "data")
    drawn = sorted(p.read_bytes() for p in (block / "figures").iterdir())
    assert sorted(base64.b64decode(s.partition("base64,")[2]) for s in sources) == drawn
    kinds = {s.partition(";")[0] for s in sources}
    assert kinds == {"data:image/png", "data:image/gif"}
    assert len(page.values("alt")) == len(drawn)
    assert "<" not in page.text.replace("< ε", "")  # no markup shown as text


def test_page_tells_settings_results_and_how(block):
    """Status, every setting with its unit, ledger, patches, phases, log and command."""
    page, record = page_of(block), Record(block)
    assert "Finished." in page.text and "Block" in page.text
    for heading in ("Checks", "Contact", "Energy", "Figures", "Computation", "Settings", "Log"):
        assert heading in page.text
    assert "friction dissipation" in page.text and "balance error" in page.text
    assert f"{record.contacts['face'].patches[-1][1].normal_force / 1e3:#.4g}" in page.text
    assert "stepping: " in page.text and "audit: step" in page.text
    assert "internal force" in page.text and "squealx run sliding-block --set" in page.text
    rows = {(t.title, key): (value, unit) for t in settings(record.checked)
            for key, value, unit in t.cells}  # fmt: skip
    assert rows["bodies.block", "material.youngs_modulus"] == ("2.1\u202f×\u202f10¹¹", "Pa")
    assert rows["loads.0", "traction"][1] == "Pa" and rows["time", "end"][1] == "s"
    leaves = json.dumps(record.checked.tables()).count('": ')
    assert len(rows) > 0.7 * leaves  # the rest are names of tables


def test_everything_is_escaped(copied):
    """Text of the scene, the log and the status is shown, never understood."""
    evil = "<script>alert('x')</script> & <b>"
    scene = Record(copied).scene | {"title": evil, "about": evil}
    (copied / "scene.toml").write_text(tomli_w.dumps(scene), "utf-8")
    summary = json.loads((copied / "summary.json").read_text())
    summary |= {"status": f"stopped: {evil}", "memory": {evil: 1.5}}
    (copied / "summary.json").write_text(json.dumps(summary))
    with (copied / "run.log").open("a") as log:
        log.write(f"00:00:00 {evil}\n")
    page = page_of(copied)
    assert not {"script", "b"} & {tag for tag, a in page.tags if a or tag == "script"}
    assert page.text.count("alert('x')") >= 5


def test_scene_without_contact(tmp_path):
    """No sections of contact, one figure of energy; fields are not needed."""
    scene = Scene.load("bar-wave", **{"time.end": 4e-6, "output.fields": False})
    run(scene, tmp_path / "wave", quiet=True)
    page = page_of(tmp_path / "wave")
    ids = {attrs["id"] for _, attrs in page.tags if "id" in attrs}
    assert "contact" not in ids and {"energy", "checks", "settings"} <= ids
    assert "friction cone" not in page.text and len(page.values("src")) == 1


def test_stopped_and_killed_runs(tmp_path, copied):
    """Why it was stopped and how to go on; without a summary or output the page is still made."""
    scene = Scene.load("sliding-block", **SHORT, **{"guards.penetration": 1e-4})
    with pytest.raises(GuardError, match="penetration"):
        run(scene, tmp_path / "stopped", quiet=True)
    page = page_of(tmp_path / "stopped")
    assert "Stopped: contact face: penetration" in page.text and "fail" in page.text
    assert f"squealx run --resume --out {tmp_path / 'stopped'}" in page.text
    (copied / "summary.json").unlink()
    page = page_of(copied)
    assert "Unfinished: no summary.json" in page.text and "--resume" in page.text
    with h5py.File(copied / "results.h5", "w") as file:
        for name in ("history", "contact", "patches"):
            file.create_group(name)
    assert not page_of(copied).values("src")


def test_checks_pass_here_and_fail_where_they_should(block, copied):
    """The run passes all; twice the shear, a jump of the ledger or deep nodes are told."""
    summary = json.loads((block / "summary.json").read_text())
    fine = {c.name: c.passed for c in checks(Record(block), summary)}
    assert len(fine) >= 6 and all(fine.values())
    with h5py.File(copied / "results.h5", "a") as file:
        for group in file["contact/face"].values():
            group["tangential_force"][:] *= 2
        file["history/balance_error"][2] = -0.2
        file["history/guarded_error"][2] = -0.3
        file["history/face_max_penetration"][1] = 1.0
        file["history/friction_dissipation"][-1] = 0.0
    wrong = {c.name for c in checks(Record(copied), summary) if c.passed is False}
    told = "friction cone of face", "energy balance", "penetration of face, in cells"
    assert wrong == {*told, "friction takes energy", "energy of the contact"}
    short = contents(Record(copied), [])["in_short"]
    assert "Failed" in short[-1] and all(name in short[-1] for name in wrong)


def test_load_at_rest_is_checked_and_theory_is_drawn(tmp_path):
    """A cylinder at rest bears its load; its pressure and force are drawn with closed forms."""
    scene = Scene.load("hertz-cylinder", **{"mesh.size": 4e-4, "output.fields": False})
    folder = run(scene, tmp_path / "cylinder", quiet=True).folder
    found = {c.name: c for c in checks(Record(folder), {"status": "done"})}
    load = found["load on touch at rest"]
    assert load.passed and "1.8 kN" in load.limit  # 72 MPa on 50 mm x 0.5 mm
    page, drawn = page_of(folder), sorted(f.stem for f in (folder / "figures").iterdir())
    assert drawn == ["energy", "history", "pressure"]  # at rest: nothing to animate
    assert "against Hertz" in page.text
    with h5py.File(folder / "results.h5", "a") as file:
        file["contact/touch/0/normal_force"][:] *= 1.02
    again = {c.name: c.passed for c in checks(Record(folder), {"status": "done"})}
    assert again["load on touch at rest"] is False


def test_command_does_the_same_run(block, tmp_path):
    """Built-in scenes by what was changed of them, any other by its file."""
    for name, changes in (
        ("sliding-block", {"mesh.size": 1.5e-3, "mesh.block": [0.01, 0.02, 0.03]}),
        ("flange-transition", {"rolling.angle_of_attack": 0.01, "mesh.rail_profile": "60E1",
                               "contacts.wheel_rail.smooth": True}),
    ):  # fmt: skip
        scene = Scene.load(name, **changes)
        (tmp_path / "scene.toml").write_text(tomli_w.dumps(scene.tables()), "utf-8")
        words = shlex.split(command(Record(tmp_path)))
        assert words[:3] == ["squealx", "run", name] and words[-2:] == ["--out", "NEW"]
        options = [w for w in words[3:-2] if w != "--set"]
        assert load(name, options).tables() == scene.tables()
    tables = Scene.load("hertz").tables()
    tables["supports"].pop()
    (tmp_path / "scene.toml").write_text(tomli_w.dumps(tables), "utf-8")
    assert f"{tmp_path / 'scene.toml'} --out NEW" in command(Record(tmp_path))


def test_command_line(block, monkeypatch, capsys, tmp_path):
    """One line or one JSON object on stdout; a folder without a run is bad input, exit code 2."""

    def call(*words) -> int:
        monkeypatch.setattr(sys, "argv", ["squealx", "report", *map(str, words)])
        try:
            main()
        except SystemExit as stop:
            return int(stop.code or 0)
        return 0

    assert call(block, "--json") == 0
    assert json.loads(capsys.readouterr().out) == {"report": str(block / "report.html")}
    assert call(tmp_path) == 2
    assert "folder" in (told := capsys.readouterr().err) and "scene.toml" in told
    (tmp_path / "scene.toml").write_text("name = ")
    (tmp_path / "results.h5").write_bytes(b"no HDF5")
    assert call(tmp_path) == 2 and str(tmp_path) in capsys.readouterr().err
    assert call(tmp_path / "nowhere") == 2


@pytest.mark.parametrize(
    ("value", "shown", "told"),
    [
        (0.0, "0", "0"),
        (-0.0, "0", "0"),
        (62.6, "62.60", "62.6"),
        (-1234.0, "−1234", "−1234"),
        (2.1e11, "2.100\u202f×\u202f10¹¹", "2.1\u202f×\u202f10¹¹"),
        (-1e-4, "−0.0001000", "−1\u202f×\u202f10⁻⁴"),
        (np.nan, "–", None),
    ],
)
def test_numbers_read_as_in_print(value, shown, told):
    """True minus, powers of ten, zeros at the end where columns line up."""
    assert number(value, zeros=True) == shown
    assert told is None or exact(value) == told
