# SPDX-License-Identifier: LGPL-3.0-or-later
"""The cache of meshes: what comes back, when it is made anew, and that it never stops a run."""

import dataclasses
import os

import numpy as np
import pytest

from meshes import cache
from meshes.profiles.placement import Placement
from meshes.shapes import blocks
from workflow import Scene
from workflow.model.geometry import mesh_of

PLACEMENT = Placement(
    0.1, 0.02, 0.001, np.array([0.0, 1 / 3, 0.46]), np.float64(2 / 3), np.ones(3) / 7, 0.35,
    np.ones(3) / 9, 3e-4, 1.2, 0.47, 0.06, 0.05, 0.035, 0.024,
)  # fmt: skip


@pytest.fixture
def folder(monkeypatch, tmp_path):
    """An empty cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "squealx" / "meshes"


class Maker:
    """Makes a small mesh and counts how often."""

    def __init__(self) -> None:
        self.mesh = blocks.block((0, 0, 0), (1, 1, 1 / 3), cells=(3, 2, 2))
        self.placement = PLACEMENT
        self.times = 0
        self.log: list[str] = []

    def __call__(self):
        self.times += 1
        return self.mesh, self.placement

    def get(self, name: str = "a"):
        return cache.cached(name, self, self.log.append)


def same(a, b) -> bool:
    values = [(getattr(a[0], k), getattr(b[0], k)) for k in cache.ARRAYS]
    values += [(getattr(a[1], k), getattr(b[1], k)) for k in Placement.__dataclass_fields__]
    return all(np.array_equal(x, y) for x, y in values) and a[0].names == b[0].names


def test_kept_mesh_is_the_made_one(folder):
    """Made once; arrays, names and placement equal to the last bit, dtypes too."""
    make = Maker()
    first, second = make.get(), make.get()
    assert make.times == 1 and same(first, second)
    assert all(getattr(first[0], k).dtype == getattr(second[0], k).dtype for k in cache.ARRAYS)
    assert len(make.log) == 1 and "taken from the cache" in make.log[0]
    assert [p.name for p in folder.iterdir()] == ["a.npz"]


def test_placement_of_a_wheel_without_flange_is_kept(folder):
    """What such a wheel does not have comes back as None."""
    gone = {k: None for k in Placement.__dataclass_fields__ if k.startswith("flange")}
    gone |= {"flange_rail_s": None}
    make = Maker()
    make.placement = dataclasses.replace(PLACEMENT, **gone)
    first, second = make.get(), make.get()
    assert make.times == 1 and same(first, second) and second[1].flange_gap is None


@pytest.mark.parametrize("damage", ["short", "empty", "byte", "text"])
def test_damaged_file_is_made_again(folder, damage):
    """Half a file, none of it, one byte of the coordinates, something else: told, and mended."""
    make = Maker()
    first = make.get()
    path = folder / "a.npz"
    data = bytearray(path.read_bytes())
    at = data.index(make.mesh.points.tobytes()[40:80])
    data[at] ^= 1
    path.write_bytes({"short": data[:999], "empty": b"", "byte": data, "text": b"mesh"}[damage])
    assert same(first, make.get()) and make.times == 2
    assert "cannot be read" in make.log[0]
    assert same(first, make.get()) and make.times == 2


def test_cache_that_cannot_be_written_is_only_told(monkeypatch, tmp_path):
    """A file where the folder should be; no home at all."""
    (tmp_path / "squealx").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    make = Maker()
    assert make.get()[0] is make.mesh and "not kept" in make.log[-1]

    def homeless():
        raise RuntimeError("no home")

    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr(cache.Path, "home", staticmethod(homeless))
    assert make.get()[0] is make.mesh and "no home" in make.log[-1]


def test_write_that_fails_leaves_nothing(folder, monkeypatch):
    """A full disk: the half-written file goes, the run goes on."""

    def full(file, **arrays):
        file.write(b"half")
        raise OSError("no space left")

    monkeypatch.setattr(cache.np, "savez", full)
    make = Maker()
    assert make.get()[0] is make.mesh and "no space left" in make.log[-1]
    assert not list(folder.iterdir())


def test_oldest_files_go(folder):
    """Beyond the bound those used longest ago are removed; a hit counts as use."""
    make = Maker()
    for age, name in enumerate("abcd"):
        make.get(name)
        os.utime(folder / f"{name}.npz", (1e9 + age, 1e9 + age))
    make.get("a")
    size = (folder / "a.npz").stat().st_size
    cache.trim(folder, 2.5 * size)
    assert sorted(p.stem for p in folder.iterdir()) == ["a", "d"]
    cache.trim(folder, 0)
    assert [p.stem for p in folder.iterdir()] == ["a"]


def test_key_follows_everything_that_makes_a_mesh(tmp_path, monkeypatch):
    """Another value, another profile of the same name, edited code: another key; else the same."""
    profile, code = tmp_path / "p.csv", tmp_path / "code.py"
    profile.write_text("0, 0")
    code.write_text("1")
    inputs = {"mesh": {"size": 0.1, "wheel_profile": str(profile)}, "zone": (0.0, 1.0)}
    keys = [cache.key(inputs, [code]), cache.key(inputs | {"zone": (0.0, 2.0)}, [code])]
    assert keys[0] == cache.key(inputs, [code])
    profile.write_text("0, 1")
    keys.append(cache.key(inputs, [code]))
    code.write_text("2")
    keys.append(cache.key(inputs, [code]))
    package = tmp_path / "meshes"
    package.mkdir()
    monkeypatch.setattr(cache, "__file__", str(package / "cache.py"))
    keys.append(cache.key(inputs, [code]))
    (package / "sweep.py").write_text("")
    keys.append(cache.key(inputs, [code]))
    assert len(set(keys)) == len(keys)


@pytest.mark.slow
def test_wheel_on_rail_is_kept(folder):
    """The main scene, coarse: taken again for other friction, made for another yaw."""
    log: list[str] = []
    small = {"mesh.size": 0.008, "mesh.rail_length": 3.0}
    scene = Scene.load("flange-transition", **small)
    first = mesh_of(scene, log.append)
    friction = scene.with_(**{"contacts.wheel_rail.friction": 0.3})
    assert not log and same(first, mesh_of(friction, log.append)) and len(log) == 1
    other = mesh_of(scene.with_(**{"rolling.angle_of_attack": 0.01}), log.append)
    assert len(log) == 1 and not same(first, other)
    assert len(list(folder.iterdir())) == 2
    mesh_of(Scene.load("bar-wave"), log.append)
    assert len(log) == 1 and len(list(folder.iterdir())) == 2
