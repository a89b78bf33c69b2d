# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact surfaces as meshed: overlap, far sides of skins, flush neighbours, coarse contactors."""

import pytest
import tomli_w

from meshes.formats import read_write
from meshes.hexmesh import join
from meshes.shapes.blocks import SIDES, block
from meshes.tags import Tag
from workflow import Scene, run
from workflow.model.model import build
from workflow.scene.scene import SceneError

STEEL = {"youngs_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}
SIZE = 2.5e-3


def box(lower, upper, kind: Tag, only: Tag | None = None, size: float = SIZE):
    """Return a box: its surfaces, all or ``only`` one, are those of the contact."""
    touch, rest = {
        Tag.BLOCK: (Tag.BLOCK_BOTTOM, Tag.ZMAX),
        Tag.BASE: (Tag.BASE_TOP, Tag.BASE_BOTTOM),
    }[kind]
    surfaces = {side: touch if only in (None, side) else rest for side in SIDES}
    return block(lower, upper, size=size, region=kind, surfaces=surfaces)


def scene(folder, mesh, **contact) -> Scene:
    """Return a scene whose block falls on its base at 1 m/s."""
    read_write.write(mesh, folder / "mesh.vtu")
    return Scene.check({
        "name": "apart",
        "title": "A block and a base",
        "mesh": {"kind": "file", "path": str(folder / "mesh.vtu"), "size": SIZE},
        "bodies": {
            "block": {"regions": ["block"], "material": STEEL, "velocity": [0.0, 0.0, -1.0]},
            "base": {"regions": ["base"], "material": STEEL},
        },
        "contacts": {
            "face": {"contactor": "block_bottom", "target": "base_top", "penalty": 0.3, **contact}
        },
        "time": {"end": 4e-6, "output_interval": 1e-6},
        "output": {"fields": False},
    })  # fmt: skip


def base(only: Tag | None = None):
    return box((0, 0, -0.01), (0.02, 0.02, 0), Tag.BASE, only, size=3.1e-3)


APART = {
    "skins of the same width": (box((0, 0, 0), (0.02, 0.02, 0.01), Tag.BLOCK), base()),
    "skin on a wider one": (box((0.005, 0.005, 0), (0.015, 0.015, 0.01), Tag.BLOCK), base()),
    "side by side, flush": (box((0.02, 0, -0.01), (0.04, 0.02, 0), Tag.BLOCK), base()),
    "in a corner": (
        box((0, 0, 0), (0.01, 0.01, 0.01), Tag.BLOCK),
        box((-0.01, 0, -0.01), (0.02, 0.01, 0), Tag.BASE),
        box((-0.01, 0, 0), (0, 0.01, 0.01), Tag.BASE),
    ),
}


@pytest.mark.parametrize("two_pass", [False, True])
@pytest.mark.parametrize("case", APART)
def test_bodies_that_only_touch_are_accepted(case, two_pass, tmp_path):
    """Far sides of whole skins, 10 to 40 mm away, are no overlap; nor are flush borders."""
    assert build(scene(tmp_path, join(*APART[case]), two_pass=two_pass)).doubts == []


OVERLAPS = {  # by hand: the depth below the nearest facet of the deepest node
    "skins": (1e-3, box((0, 0, -0.001), (0.02, 0.02, 0.009), Tag.BLOCK), base()),
    "faces": (
        1e-3,
        box((0, 0, -0.001), (0.02, 0.02, 0.009), Tag.BLOCK, Tag.ZMIN),
        base(Tag.ZMAX),
    ),
    "plane strain": (
        1e-3,
        box((0, 0, -0.001), (0.02, 0.001, 0.009), Tag.BLOCK, Tag.ZMIN),
        box((0, 0, -0.01), (0.02, 0.001, 0), Tag.BASE, Tag.ZMAX),
    ),
    "inside": (4e-3, box((0.006, 0.006, -0.008), (0.014, 0.014, -0.004), Tag.BLOCK), base()),
    "far inside": (
        0.21,
        box((0.2, 0.2, -0.28), (0.21, 0.21, -0.27), Tag.BLOCK),
        box((0, 0, -0.5), (0.5, 0.5, 0), Tag.BASE, size=0.1),
    ),
}


@pytest.mark.parametrize("case", OVERLAPS)
def test_bodies_in_each_other_are_refused(case, tmp_path):
    """With the depth of the deepest node, also in the middle of a body 200 cells thick."""
    depth, *boxes = OVERLAPS[case]
    with pytest.raises(SceneError, match=rf"contacts.face: bodies overlap .* by {depth:.3e} m"):
        build(scene(tmp_path, join(*boxes)))


@pytest.mark.parametrize("skins", [False, True])
def test_a_skin_hits_as_its_face_does(skins, tmp_path):
    """The first wave, ρ c v A / 2 = 3.38 kN on 12 x 12 mm, is there after 3 µs to 5 %."""
    one, other = (None, None) if skins else (Tag.ZMIN, Tag.ZMAX)
    upper = box((0.004, 0.004, 0), (0.016, 0.016, 0.01), Tag.BLOCK, one)
    result = run(scene(tmp_path, join(upper, base(other))), tmp_path / "run", quiet=True)
    speed = (210e9 * 0.7 / (1.3 * 0.4) / 7800) ** 0.5
    force = 7800 * speed * 1.0 * 0.012**2 / 2
    assert result.history["face_normal_force"][3] == pytest.approx(force, rel=0.05)


def test_behind_a_wall_at_any_distance():
    """A bar half a metre behind a wall is not in front of it."""
    wall = {"origin": [0.6, 0.0, 0.0], "normal": [1.0, 0.0, 0.0], "half_width": 0.05}
    with pytest.raises(SceneError, match=r"bodies overlap at the start by 6.000e-01 m"):
        build(Scene.load("bar-impact", **{"contacts.wall.target": wall, "mesh.size": 5e-3}))


def test_beside_a_wall(tmp_path):
    """A bar that the square of a wall does not reach is not behind it."""
    wall = {"origin": [0.05, 1.0, 0.0], "normal": [1.0, 0.0, 0.0], "half_width": 0.05}
    build(Scene.load("bar-impact", **{"contacts.wall.target": wall, "mesh.size": 5e-3}))


def test_surfaces_that_share_nodes():
    """A face and the side beside it meet in an edge."""
    change = {"contacts.face.target": "xmin", "mesh.size": 5e-3, "mesh.base_size": 5e-3}
    with pytest.raises(SceneError, match=r"contacts.face: contactor and target share 5 nodes"):
        build(Scene.load("contact-patch", **change))


def test_a_target_between_the_nodes_of_its_contactor():
    """A block of one cell on a pillar of 4 mm: no node above it. Two passes see it."""
    change = {"mesh.size": 0.01, "mesh.base_size": 1e-3, "mesh.base": [0.004, 0.004, 0.01]}
    with pytest.raises(SceneError, match=r"nodes are 1.00e-02 m apart, the target is 4.00e-03 m"):
        build(Scene.load("contact-patch", **change))
    build(Scene.load("contact-patch", **change, **{"contacts.face.two_pass": True}))


def test_a_coarse_contactor_is_doubted():
    """Cells of 5 mm on cells of 2.9 mm, the other way round, or with quadrature points."""
    fine = {"mesh.size": 5e-3}
    told = build(Scene.load("contact-patch", **fine)).doubts
    assert len(told) == 1 and "cells of 5.00e-03 m on a target with cells of 2.86e-03 m" in told[0]
    swapped = {"contacts.face.contactor": "base_top", "contacts.face.target": "block_bottom"}
    for change in (swapped, {"contacts.face.points": "quadrature"}):
        assert build(Scene.load("contact-patch", **fine, **change)).doubts == []


def test_slip_waves_are_doubted_by_every_model():
    """Friction of two unlike bodies, from 210 to 180 GPa; not of like ones."""
    sizes = {"mesh.size": 5e-3, "mesh.base_size": 5e-3}
    unlike = {"bodies.base.material.youngs_modulus": 180e9}
    told = build(Scene.load("sliding-block", **sizes, **unlike)).doubts
    assert len(told) == 1 and "contacts.face.friction: the bodies carry slip waves" in told[0]
    assert build(Scene.load("sliding-block", **sizes)).doubts == []


WALL = "{ origin = [0.6, 0.0, 0.0], normal = [1.0, 0.0, 0.0], half_width = 0.05 }"
SAID = {
    "behind a wall": (
        "bar-impact",
        {"contacts.wall.target": WALL},
        (2, "contacts.wall: bodies overlap at the start by 6.000e-01 m"),
    ),
    "nodes in common": (
        "contact-patch",
        {"contacts.face.target": "xmin", "mesh.size": 5e-3, "mesh.base_size": 5e-3},
        (2, "contacts.face: contactor and target share 5 nodes"),
    ),
    "target falls through": (
        "contact-patch",
        {"mesh.size": 0.01, "mesh.base_size": 1e-3, "mesh.base": [0.004, 0.004, 0.01]},
        (2, "contacts.face.contactor: its nodes are 1.00e-02 m apart"),
    ),
    "coarse contactor": (
        "contact-patch",
        {"mesh.size": 5e-3},
        (0, "doubt: contacts.face.contactor: cells of 5.00e-03 m on a target with cells of 2.86"),
    ),
}


@pytest.mark.parametrize("case", SAID)
def test_validate_says_what_a_model_does(case, command):
    """Shapes are meshed for it; nothing is compiled."""
    name, change, (code, told) = SAID[case]
    words = [w for key, value in change.items() for w in ("--set", f"{key}={value}")]
    done = command("validate", name, *words, check=False)
    assert done.returncode == code and told in done.stdout + done.stderr


def test_validate_looks_into_a_mesh_file(command, tmp_path):
    """A block 4 mm inside its base."""
    depth, *boxes = OVERLAPS["inside"]
    settings = tomli_w.dumps(scene(tmp_path, join(*boxes)).tables())
    (tmp_path / "scene.toml").write_text(settings)
    done = command("validate", tmp_path / "scene.toml", check=False)
    assert done.returncode == 2 and f"bodies overlap at the start by {depth:.3e} m" in done.stderr
