# SPDX-License-Identifier: LGPL-3.0-or-later
"""Figures are drawn from a result folder alone; patches keep their number and their forces."""

import itertools
from pathlib import Path

import h5py
import numpy as np
import pytest
import tomli_w

from meshes.hexmesh import HexMesh, join
from meshes.profiles.placement import lateral_shift_for, rail_in_track
from meshes.profiles.profiles import s1002
from meshes.tags import Tag
from workflow.results.fields import FieldWriter
from workflow.results.footprints import UNITS
from workflow.scene.scene import Scene

pytest.importorskip("matplotlib")
pytest.importorskip("pyvista")

from matplotlib.path import Path as MplPath
from PIL import Image, ImageSequence

from workflow.figures import gallery, style
from workflow.figures.animation import scenery_of
from workflow.figures.footprint import development
from workflow.figures.section import cut, surface_nodes, telling_output
from workflow.results.patch_nodes import patches_of
from workflow.results.record import RAIL, Record
from workflow.simulation.run import run

YAW, SPEED, RADIUS = 0.02, 22.2, 0.46
OUTPUTS, BIRTH = 20, 12  # the gauge corner is touched from output 12 on
TIMES = 3e-4 * np.arange(OUTPUTS)


def swept(layers: list[np.ndarray], region: Tag) -> HexMesh:
    """Hexahedra between layers of points, each of shape ``(along, across, 3)``."""
    points = np.array(layers)
    index = np.arange(points[..., 0].size).reshape(points.shape[:-1])
    a, b = index[1:], index[:-1]
    corners = [
        part[:, i, j]
        for part in (a, b)
        for i, j in (
            (slice(0, -1), slice(0, -1)),
            (slice(1, None), slice(0, -1)),
            (slice(1, None), slice(1, None)),
            (slice(0, -1), slice(1, None)),
        )
    ]
    cells = np.stack([c.ravel() for c in corners], axis=-1)
    return HexMesh(
        points=points.reshape(-1, 3),
        cells=cells,
        regions=np.full(len(cells), region, dtype=np.int32),
        facets=np.zeros((0, 4), dtype=np.int64),
        surfaces=np.zeros(0, dtype=np.int32),
    )


def rail_mesh(profile, size: float) -> HexMesh:
    """A stretch of rail head, layers shrunk towards a point below the rail top."""
    outer = profile.at(np.linspace(0, profile.length, round(profile.length / size)))
    core = np.array([profile.points[:, 0].mean(), profile.points[:, 1].min()])
    x = np.concatenate(
        [np.linspace(-0.5, -0.05, 12), np.arange(-0.045, 0.21, size), np.linspace(0.22, 0.6, 10)]
    )
    layers = []
    for shrink in (0.4, 0.7, 0.85, 1.0):
        ring = np.broadcast_to(core + shrink * (outer - core), (len(x), len(outer), 2))
        layers.append(
            np.concatenate([np.broadcast_to(x[:, None, None], (*ring.shape[:2], 1)), ring], 2)
        )
    return swept(layers, Tag.RAIL_HEAD)


def wheel_mesh(placement, size: float) -> HexMesh:
    """A tyre in the track position at time zero."""
    profile = s1002()
    eta, r = profile.at(np.linspace(0, profile.length, round(profile.length / size))).T
    theta = np.concatenate([np.arange(-0.4, 0.4, size / RADIUS), np.linspace(0.41, 5.87, 80)])
    theta = np.concatenate([theta, [2 * np.pi - 0.4]])
    layers = []
    for depth in (0.06, 0.03, 0.012, 0.0):
        share = depth / 0.06
        radius = RADIUS + (1 - share) * r - depth - 0.02 * share
        y = eta * (1 - 0.1 * share)
        rings = [np.stack([radius * np.sin(a), y, -radius * np.cos(a)], axis=-1) for a in theta]
        layers.append(np.array(rings))
    mesh = swept(layers, Tag.TYRE)
    c, s = np.cos(YAW), np.sin(YAW)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return mesh.moved(mesh.points @ turn.T + placement.centre)


def rolled(points: np.ndarray, placement, t: float) -> np.ndarray:
    """Displacement of the wheel at ``t``: rolling along x, drifting until the flange touches."""
    axle = np.array([-np.sin(YAW), np.cos(YAW), 0.0])
    angle, arm = SPEED * t / RADIUS, points - placement.centre
    side = (arm @ axle)[:, None] * axle
    out = arm - side
    turned = side + np.cos(angle) * out + np.sin(angle) * np.cross(axle, out)
    drift = placement.flange_gap * min(t / TIMES[BIRTH], 1.0)
    return turned - arm + [SPEED * t, drift, 0.0]


def ellipse(surface: dict, profile, s: float, x: float, half: tuple, load: float) -> dict:
    """Surface nodes of the rail in an ellipse that carry ``load`` along its normals."""
    share = 1 - ((surface["x"] - x) / half[0]) ** 2 - ((surface["s"] - s) / half[1]) ** 2
    inside = share > 0.02
    at, share = surface["s"][inside], share[inside]
    normal = np.column_stack([np.zeros(len(at)), profile.normal(at)])
    force = load * np.sqrt(share) / np.sqrt(share).sum()
    return {
        "node": surface["node"][inside],
        "position": np.column_stack([surface["x"][inside], profile.at(at)]),
        "normal": normal,
        "normal_force": force,
        "tangential_force": 0.3 * force[:, None] * np.cross([1.0, 0, 0], normal),
        "area": np.full(len(at), 9e-6),
    }


def loads(k: int) -> list[float]:
    """Normal force on each patch at output ``k`` [N]."""
    if k < BIRTH:
        return [60e3]
    return [60e3 - 2e3 * (k - BIRTH + 1), 6e3 * (k - BIRTH + 1)]


def footprint(surface: dict, profile, placement, k: int) -> dict:
    """Arrays of one output as a run writes them."""
    x = SPEED * TIMES[k]
    lead = RADIUS * np.tan(placement.flange_angle) * np.sin(YAW)
    sizes = [(8e-3, 7e-3), (8e-3, 5e-3)]
    places = [(placement.tread_rail_s, x), (placement.flange_rail_s, x + lead)]
    parts = [
        ellipse(surface, profile, *place, size, load)
        for place, size, load in zip(places, sizes, loads(k), strict=False)
    ]
    arrays = {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}
    label = np.repeat(np.arange(len(parts)), [len(p["area"]) for p in parts])
    friction = np.full(len(label), 0.6)
    more = {"patch": label, "stick": label == 0, "slip_velocity": arrays["normal"]}
    return arrays | more | {"friction": friction}


@pytest.fixture(scope="session")
def transition(tmp_path_factory) -> Path:
    """A result folder: one contact point, then two; the mesh a tyre on a stretch of rail."""
    folder = tmp_path_factory.mktemp("transition")
    profile, placement = rail_in_track(), lateral_shift_for(yaw=YAW)
    rail = rail_mesh(profile, 3e-3)
    mesh = join(wheel_mesh(placement, 4e-3), rail)
    wheel = len(mesh.points) - len(rail.points)
    across = round(profile.length / 3e-3)
    node = np.arange(len(mesh.points) - len(rail.points) // 4, len(mesh.points))
    s = np.tile(np.linspace(0, profile.length, across), len(node) // across)
    surface = {"node": node, "x": mesh.points[node, 0], "s": s}
    scene = Scene.load("flange-transition").tables()
    (folder / "scene.toml").write_text(tomli_w.dumps(scene), "utf-8")
    writer = FieldWriter(folder / "fields.vtkhdf", mesh)
    with h5py.File(folder / "results.h5", "w") as file:
        for k, t in enumerate(TIMES):
            u = np.zeros_like(mesh.points)
            u[:wheel] = rolled(mesh.points[:wheel], placement, t)
            writer.append(t, u, u)
            group = file.create_group(f"contact/wheel_rail/{k}")
            group.attrs["t"] = t
            for name, values in footprint(surface, profile, placement, k).items():
                group.create_dataset(name, data=values).attrs["units"] = UNITS[name]
        turn = 2 * np.pi * TIMES / TIMES[-1]
        ledger = {
            "t": TIMES,
            "kinetic": 1e5 - 20 * np.sin(turn),
            "internal": 50 + 15 * np.sin(turn),
            "hourglass": 0 * turn,
            "friction_dissipation": 12 * TIMES / TIMES[-1],
            "external_work": 10 * TIMES / TIMES[-1],
            "balance_error": 1e-4 * np.sin(3 * turn),
        }
        for name, values in ledger.items():
            file[f"history/{name}"] = values
        rows = [(t, place) for k, t in enumerate(TIMES) for place in range(len(loads(k)))]
        angle = np.array([placement.tread_angle, placement.flange_angle])
        creepage = np.array([[1e-3, 2e-3], [-0.015, -0.055]])
        t, place = np.array(rows).T
        force = np.array([6e4, 3e4])
        columns = {"contact_angle": angle, "creepage": creepage, "normal_force": force}
        for name, values in columns.items():
            file[f"patches/wheel_rail/{name}"] = values[place.astype(int)]
        file["patches/wheel_rail/t"] = t
    return folder


def not_blank(path: Path) -> bool:
    """Tell whether a PNG has more than its ground colour on it."""
    from matplotlib.image import imread

    image = imread(path)[..., :3]
    return image.shape[1] >= 1000 and 0.005 < (image < 0.98).any(axis=-1).mean() < 0.95


def test_transition_has_all_figures(transition):
    """Model, placement, footprints, section, patches and energy, none of them blank."""
    paths = gallery.draw(transition)
    names = ["model", "placement", "footprints", "cross_section", "contact_nodes", "at_rest"]
    names += [
        "half_spaces",
        "patch_forces",
        "patch_means",
        "adhesion",
        "centre_line",
        "shear_vectors",
        "energy",
    ]
    assert [p.name for p in paths] == [*(f"{n}.png" for n in names), "transition.gif"]
    assert all(p.parent == transition / "figures" and not_blank(p) for p in paths[:-1])
    frames = ImageSequence.Iterator(Image.open(paths[-1]))
    pictures = [np.asarray(f.convert("RGB"), dtype=int) for f in frames]
    assert len(pictures) == OUTPUTS and paths[-1].stat().st_size < 3e6
    moved = [(a != b).any(axis=-1).mean() for a, b in itertools.pairwise(pictures)]
    assert min(moved) > 1e-3  # of the pixels: footprints and the mark of time


def test_patches_keep_place_and_force(transition):
    """One patch before, two after; forces, angles and areas are those put in."""
    contact = Record(transition).contacts["wheel_rail"]
    placement = lateral_shift_for(yaw=YAW)
    np.testing.assert_array_equal(contact.two_points, np.arange(OUTPUTS) >= BIRTH)
    np.testing.assert_allclose(contact.t, TIMES)
    rail_top, corner = (contact.series(k, "normal_force") for k in (1, 2))
    np.testing.assert_allclose(rail_top, [loads(k)[0] for k in range(OUTPUTS)])
    np.testing.assert_allclose(corner[BIRTH:], [loads(k)[1] for k in range(BIRTH, OUTPUTS)])
    assert np.isnan(corner[:BIRTH]).all()
    angle, near = [placement.tread_angle, placement.flange_angle], np.radians(3)
    np.testing.assert_allclose(contact.series(1, "contact_angle"), angle[0], atol=near)
    np.testing.assert_allclose(contact.series(2, "contact_angle")[BIRTH:], angle[1], atol=near)
    assert telling_output(contact) == OUTPUTS - 1


@pytest.mark.parametrize("fragments", [1, 3])
def test_patch_number_comes_from_steepness(fragments):
    """The gauge corner is patch 2 even where it comes first, alone or broken into fragments."""
    steep, flat = np.array([0, -0.94, 0.34]), np.array([0, 0, 1.0])
    n = 2 * fragments
    arrays = {
        "position": np.zeros((n, 3)),
        "normal": np.array([steep] * fragments + [flat] * fragments),
        "normal_force": np.arange(1.0, n + 1),
        "tangential_force": np.zeros((n, 3)),
        "area": np.ones(n),
        "patch": np.arange(n),
    }
    patches = patches_of(arrays)
    assert patches[2].normal_force == sum(range(1, fragments + 1))
    assert patches[1].normal_force + patches[2].normal_force == n * (n + 1) / 2
    # the same seen from the other body, nodes out of touch left out
    turned = patches_of(arrays | {"normal": -arrays["normal"]})
    np.testing.assert_allclose(turned[1].direction, flat)
    assert set(
        patches_of(arrays | {"normal_force": np.r_[np.ones(fragments), np.zeros(fragments)]})
    ) == {2}


def test_developed_surface_is_the_profile(transition):
    """Arc length over the rail top as on the drawing, there and back to round-off."""
    record, profile = Record(transition), rail_in_track()
    flat = development(record.body.part(record.body.regions == Tag.RAIL_HEAD), 0.05)
    assert flat.s[-1] - flat.s[0] == pytest.approx(profile.length, rel=5e-3)
    there = np.column_stack([np.zeros(9), np.linspace(-0.04, 0.04, 9)])
    np.testing.assert_allclose(flat.flat(flat.on_rail(there)), there, atol=1e-12)


def test_cut_has_wheel_above_rail(transition):
    """Through the contact: the rail ends at its top, the flange reaches 28 mm beneath it."""
    record = Record(transition)
    body = record.body
    polygons = cut(body, body.points + record.displacement(TIMES[5]), SPEED * TIMES[5])
    rail = np.vstack([p for is_rail, p in polygons if is_rail])
    wheel = np.vstack([p for is_rail, p in polygons if not is_rail])
    assert rail[:, 1].max() == pytest.approx(0, abs=1e-4)
    assert -0.030 < wheel[:, 1].min() < -0.025
    assert len(polygons) > 100 and set(RAIL) >= {Tag.RAIL_HEAD}


def test_frames_cut_the_wheel_where_it_has_rolled_to(transition):
    """At every output the cut has the wheel 2 mm over the contact and the rail 2 mm below it."""
    record = Record(transition)
    scenery = scenery_of(record, record.contacts["wheel_rail"])
    assert len(scenery.cut) == OUTPUTS
    for patches, polygons in zip(scenery.contact.patches, scenery.cut, strict=True):
        patch = max(patches.values(), key=lambda p: p.normal_force)
        for rail, side in ((False, 1), (True, -1)):
            probe = patch.centre[1:] + side * 2e-3 * patch.direction[1:]
            cells = [MplPath(corners) for is_rail, corners in polygons if is_rail == rail]
            assert any(cell.contains_point(probe) for cell in cells)


def test_surface_nodes_are_those_of_the_outer_faces():
    """4 x 3 x 2 cells: all nodes but the 3 x 2 x 1 inside; a plane of them has none inside."""
    layers = [np.stack(np.mgrid[:5, :4, k : k + 1], -1)[:, :, 0] * 1.0 for k in range(3)]
    mesh = swept(layers, Tag.BLOCK)
    inside = np.setdiff1d(np.arange(len(mesh.points)), surface_nodes(mesh.cells))
    assert len(inside) == 6
    np.testing.assert_array_equal(np.unique(mesh.points[inside, 2]), [1.0])


def test_small_scenes_have_what_they_have(tmp_path):
    """A bar alone has model and energy, one at a wall its force; without fields no model."""
    short = {"time.end": 4e-6, "mesh.size": 2.5e-3}
    wave = run(Scene.load("bar-wave", **short), tmp_path / "wave", quiet=True)
    assert [p.stem for p in gallery.draw(wave.folder)] == ["model", "energy"]
    scene = Scene.load("bar-impact", **short, **{"output.fields": False})
    hit = run(scene, tmp_path / "hit", quiet=True)
    paths = gallery.draw(hit.folder)
    assert [p.stem for p in paths] == ["energy", "history"]
    assert all(not_blank(p) for p in paths)


@pytest.mark.parametrize(
    ("values", "shown"),
    [
        ([0.0], (1.0, "N")),
        ([-2.5e4, 3], (1e-3, "kN")),
        ([2e-6, np.nan], (1e6, "µN")),
        ([1e3], (1e-3, "kN")),
    ],
)
def test_prefix_suits_the_largest_value(values, shown):
    """The largest number reads as 1 to 1000; what is not finite does not count."""
    factor, unit = style.prefixed(values, "N")
    assert factor == pytest.approx(shown[0]) and unit == shown[1]
