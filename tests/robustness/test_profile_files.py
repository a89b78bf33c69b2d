# SPDX-License-Identifier: LGPL-3.0-or-later
"""Profile files damaged at random: a sentence or a profile, nothing else, and soon."""

import random
import time
from itertools import product

import numpy as np
import pytest

from meshes.profiles.measured import read
from meshes.profiles.profiles import rail_54e1, s1002

LIMIT = 20.0  # for one file on a busy machine; what hangs takes for ever [s]
ENDINGS = (".csv", ".ban", ".whl", ".mpt", ".prr", ".prw")
TEXTS = (
    b"nan",
    b"inf",
    b"1e999",
    b"-1e308",
    b"0",
    b"\x00",
    b"\xff\xfe",
    b"",
    b",",
    b";",
    b"=",
    b"[",
)


def sound(kind, ending):
    """Return a sound file of a kind: a table, a MiniProf or a SIMPACK file, in mm."""
    drawn = s1002() if kind == "wheel" else rail_54e1()
    points = drawn.at(np.linspace(0, drawn.length, 90)) * 1e3
    if ending in (".prr", ".prw"):
        rows = "\n".join(f"{y:.5f} {z:.5f}" for y, z in points)
        return (
            f"header.begin\n type = {int(kind == 'wheel')}\nheader.end\nspline.begin\n"
            f" units.len.f = 1000\n shift.y = 0\n rotate = 0\n point.begin\n{rows}\n point.end\n"
            "spline.end\n"
        ).encode()
    rows = "\n".join(f"{y:.4f} {z:.4f}" for y, z in points)
    if ending == ".mpt":
        return f"[FileInfo]\n[Profile1Info]\nColumnDef=X,Y\n[Profile1Points]\n{rows}\n".encode()
    if ending in (".ban", ".whl"):
        return f"Date=1\nXoffset=0\nColumnDef=X,Y\nXYPoints=90\n\n{rows}\n".encode()
    return f"y [mm]  z [mm]\n{rows}\n".encode()


def damaged(data, rng):
    """Return bytes cut, doubled, shuffled or written over somewhere."""
    lines = data.split(b"\n")
    a, b = sorted(rng.randrange(len(lines)) for _ in range(2))
    at = rng.randrange(len(data))
    ways = (
        lambda: data[:at],
        lambda: data[at:],
        lambda: b"\n".join([*lines[:b], *lines[a:]]),
        lambda: b"\n".join(lines[:a] + lines[b:]),
        lambda: b"\n".join(lines[:a] + lines[a:b][::-1] + lines[b:]),
        lambda: b"\n".join(rng.sample(lines, len(lines))),
        lambda: data[:at] + rng.choice(TEXTS) + data[at + rng.randrange(9) :],
        lambda: data[:at] + rng.randbytes(20) + data[at:],
        lambda: data.replace(b"0.", b"9" * rng.randrange(400) + b"."),
        lambda: data.replace(b".", rng.choice((b",", b"..", b"e", b" "))),
        lambda: b"\n".join(line.split(b" ")[0] for line in lines),
        lambda: b"\n".join(line + b" 1.5" for line in lines),
        lambda: rng.randbytes(rng.randrange(3000)),
        lambda: b"\n".join([lines[b]] * rng.randrange(1, 400)),
        lambda: data.decode("latin-1").encode(rng.choice(("utf-16", "utf-16-le", "utf-32"))),
    )
    return rng.choice(ways)()


def outcome(path, **how):
    """Return how the reading of a file ends, and check that it ends well and soon."""
    start = time.perf_counter()
    try:
        found = read(path, **how)
    except ValueError as error:
        end = "refused"
        assert str(error).startswith(f"profile {path}: ") and len(str(error)) < len(str(path)) + 400
    else:
        end = "read"
        assert np.isfinite(found.profile.points).all() and found.profile.length < 2.0
        assert found.in_words() and all(found.doubts())
    assert time.perf_counter() - start < LIMIT
    return end


@pytest.mark.parametrize(("kind", "ending"), list(product(("wheel", "rail"), ENDINGS)))
def test_damage_ends_in_a_sentence(tmp_path, kind, ending):
    """30 damaged copies of a sound file: each is refused in a sentence, or is a finite curve."""
    rng, data = random.Random(f"{kind} {ending}"), sound(kind, ending)
    path = tmp_path / f"points{ending}"
    path.write_bytes(data)
    if (kind == "wheel") != (ending in (".ban",)):
        assert outcome(path) == "read" or (kind, ending) == ("rail", ".whl")
    ends = []
    for _ in range(30):
        worse = damaged(data, rng)
        path.write_bytes(damaged(worse, rng) if worse and rng.random() < 0.3 else worse)
        ends.append(outcome(path, smoothing=rng.choice((0.0, 1e-5))))
    assert "refused" in ends


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_much_damage_ends_in_a_sentence(tmp_path, seed):
    """150 damaged copies of sound files of every kind."""
    rng = random.Random(seed)
    for _ in range(150):
        ending = rng.choice(ENDINGS)
        worse = damaged(sound(rng.choice(("wheel", "rail")), ending), rng)
        path = tmp_path / f"points{ending}"
        path.write_bytes(damaged(worse, rng) if worse and rng.random() < 0.4 else worse)
        outcome(path, smoothing=rng.choice((0.0, 1e-6, 1e-5, 1e-3)))


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((1, 2)),
        np.zeros((5, 2)),
        np.random.default_rng(0).normal(scale=20, size=(20000, 2)),
        np.column_stack([np.linspace(-30, 30, 8000), np.tile([0.0, 5e-3], 4000)]),
        np.column_stack([np.linspace(-30, 30, 3000), np.tile([0.0, 9.0], 1500)]),
        np.linspace(1, 30, 9000)[:, None]
        * np.column_stack([f(np.linspace(0, 600, 9000)) for f in (np.cos, np.sin)]),
    ],
    ids=["one", "all the same", "a cloud", "saw", "tall saw", "spiral"],
)
def test_odd_points_end_soon(tmp_path, points):
    """One point, a cloud, saws, a spiral of 95 turns: a sentence or a curve, soon."""
    path = tmp_path / "points.csv"
    path.write_text("\n".join(f"{y:.6f} {z:.6f}" for y, z in points))
    outcome(path, kind="rail")
    outcome(path, kind="wheel", smoothing=1e-5)


def test_a_million_points_are_refused_soon(tmp_path):
    """A million lines: refused by their number, with how many to keep."""
    path = tmp_path / "points.csv"
    path.write_text("12.5 0.25\n" * 10**6)
    assert outcome(path, kind="rail") == "refused"
