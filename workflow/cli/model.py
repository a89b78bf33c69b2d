# SPDX-License-Identifier: LGPL-3.0-or-later
"""Verbs of a scene before its run: validate, audit, export, mesh, modes, squeal."""

from pathlib import Path
from typing import Annotated, Any

import typer

from workflow.cli.options import (
    Changes,
    Json,
    Oversubscribe,
    Ranks,
    SceneName,
    answer,
    examples,
    load,
    on_ranks,
    progress,
)
from workflow.scene.scene import Scene, SceneError
from workflow.simulation.ranks import check as check_ranks
from workflow.simulation.ranks import in_mpi

verbs = typer.Typer()


@verbs.command(
    epilog=examples(
        "squealx validate my-scene.toml",
        "squealx validate flange-transition --set rolling.angle_of_attack=0.03",
    )
)
def validate(
    scene: SceneName,
    changes: Changes = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Where the results are to go, for room there; runs/NAME if left out."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Check a scene before its run, as that does: an error names the key, what it got and expects.

    Says what a run would cost, and what is doubtful about it.
    """
    checked = load(scene, changes)
    from workflow.model.advice import doubts
    from workflow.model.apart import check_contacts
    from workflow.model.checks import check, check_room
    from workflow.model.geometry import read_mesh, readings
    from workflow.model.zones import zones_in_words

    mesh = read_mesh(checked, progress())
    cost = check(checked, mesh)
    told = list(readings(checked.mesh)) if checked.mesh.kind == "wheel-on-rail" else []
    zones = list(zones_in_words(checked, mesh))
    room = check_room(checked, cost, out or Path("runs") / checked.name)
    doubtful = [*doubts(checked, cost), *room, *check_contacts(checked, cost, mesh)]
    found = {"scene": checked.name, "valid": True, "cost": cost.table(), "doubts": doubtful}
    found |= {"profiles": told} if told else {}
    found |= {"zones": zones} if zones else {}
    lines = [
        f"{checked.name}: valid",
        *told,
        *zones,
        f"cost: {cost}",
        *(f"doubt: {d}" for d in doubtful),
    ]
    answer(as_json, found, lambda: lines)


@verbs.command(
    epilog=examples(
        "squealx audit flange-transition",
        "squealx audit sliding-block --set contacts.face.penalty=2.0 --json",
    )
)
def audit(scene: SceneName, changes: Changes = None, as_json: Json = False) -> None:
    """Tell what a run will bear: step, penalty and damping limits, penetration, time, doubts."""
    checked = load(scene, changes)
    from mpi4py import MPI

    from workflow.audit.audit import printout, report

    root = MPI.COMM_WORLD.rank == 0
    found = report(checked, log=progress(quiet=not root))
    if root:
        answer(as_json, found, lambda: printout(found))


@verbs.command(
    epilog=examples(
        "squealx export hertz hertz.msh",
        "squealx export flange-transition wheel.vtu --set mesh.size=0.002",
    )
)
def export(
    scene: SceneName,
    file: Annotated[
        Path, typer.Argument(help="Mesh file to write: .msh, .vtu, .vtk, .xdmf or .inp.")
    ],
    changes: Changes = None,
    as_json: Json = False,
) -> None:
    """Write the mesh of a scene with its regions and surfaces as named groups."""
    checked = load(scene, changes)
    from workflow.model import geometry
    from workflow.model.checks import check

    check(checked)
    written = geometry.export(checked, file)
    answer(as_json, written, lambda: [geometry.in_words(written)])


@verbs.command(
    epilog=examples(
        "squealx mesh flange-transition",
        "squealx mesh flange-transition --set mesh.size=0.001 --out runs/fine-mesh",
    )
)
def mesh(
    scene: SceneName,
    changes: Changes = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for mesh.json and mesh.png; runs/mesh-NAME.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Make the mesh of a scene and show its sizes, its shapes and which cells set the step."""
    checked = load(scene, changes)
    from workflow.audit import figures
    from workflow.audit import mesh as quality
    from workflow.model.checks import check

    check(checked)
    found = quality.report(checked, progress())
    folder = out or Path("runs") / f"mesh-{checked.name}"
    paths = figures.write(found, folder)
    answer(as_json, quality.summary(found), lambda: [*quality.printout(found), *map(str, paths)])


@verbs.command(
    epilog=examples(
        "squealx modes flange-transition --set bodies.wheelset.element=one-point",
        "squealx modes flange-transition --held free --to 6000 --ranks 2",
        "squealx modes flange-transition --part wheelset --to 2000",
        "squealx modes flange-transition --to 1000 --speed 30",
        "squealx modes bar-wave --to 70000",
    )
)
def modes(
    scene: SceneName,
    changes: Changes = None,
    out: Annotated[
        Path | None, typer.Option(help="New folder; runs/NAME-modes if left out.")
    ] = None,
    part: Annotated[
        str | None,
        typer.Option(help="'wheel' (without axle) or a body; the wheel, or the first body."),
    ] = None,
    held: Annotated[
        str | None,
        typer.Option(help="'free', 'bore' (wheel), 'supports' (of the scene) or SURFACE,..."),
    ] = None,
    to: Annotated[float, typer.Option(metavar="HZ", help="Highest frequency.")] = 10e3,
    size: Annotated[
        float, typer.Option(metavar="M", help="Cells of the section of the wheel.")
    ] = 0.026 / 3,
    most: Annotated[int, typer.Option(min=1, help="Refuse to look for more modes.")] = 500,
    speed: Annotated[
        float | None,
        typer.Option(metavar="M/S", help="Speed of a wheel seen from the track; the scene's."),
    ] = None,
    ranks: Ranks = 1,
    oversubscribe: Oversubscribe = False,
    as_json: Json = False,
) -> None:
    """Find all natural modes of a wheel or body up to a frequency: table, shapes, figures."""
    checked = load(scene, changes)
    folder = out or Path("runs") / f"{checked.name}-modes"
    if ranks > 1 and not in_mpi():
        check_start("modes", folder, ranks, oversubscribe)
        words = ["modes", "--to", str(to), "--size", str(size), "--most", str(most)]
        words += [f"--part={part}"] * bool(part) + [f"--held={held}"] * bool(held)
        words += [f"--speed={speed}"] * (speed is not None)
        raise typer.Exit(on_ranks(ranks, scene, changes, folder, as_json, tuple(words)))
    wanted = {"part": part, "held": held, "top": to, "size": size, "most": most, "speed": speed}
    find_modes(checked, folder, as_json, **wanted)


def check_start(verb: str, folder: Path, ranks: int, oversubscribe: bool) -> None:
    """Refuse ranks or a folder that cannot be had: once, before there are ranks."""
    from workflow.results.folder import kept

    check_ranks(ranks, oversubscribe)
    with kept(folder, f"squealx {verb}"):
        pass


def find_modes(scene: Scene, folder: Path, as_json: bool, **wanted: Any) -> None:
    """Find modes on these ranks, draw and print them; ``wanted`` as ``workflow.modes.modes``."""
    from mpi4py import MPI

    from workflow.modes.figures import draw
    from workflow.modes.modes import modes, printout

    root = MPI.COMM_WORLD.rank == 0
    found = modes(scene, folder, log=progress(quiet=not root), **wanted)
    if root:
        draw(found, folder)
        answer(as_json, found.summary, lambda: printout(found.summary))


@verbs.command(
    epilog=examples(
        "squealx squeal sliding-block --to 90000 --set contacts.face.friction=0.6",
        "squealx squeal mode-coupling --to 3000 --friction 0.2,0.25,0.3,0.35",
        "squealx squeal stick-slip --to 20000 --slip 4,0,0 --road projection",
        "squealx squeal steady-curving --to 3000 --road projection --angles 0.01,0.02,0.04",
    )
)
def squeal(
    scene: SceneName,
    changes: Changes = None,
    out: Annotated[
        Path | None, typer.Option(help="New folder; runs/NAME-squeal if left out.")
    ] = None,
    to: Annotated[float, typer.Option(metavar="HZ", help="Highest frequency.")] = 10e3,
    road: Annotated[
        str, typer.Option(help="'full' matrices, or 'projection' on real and contact modes.")
    ] = "full",
    friction: Annotated[
        str | None,
        typer.Option(
            metavar="F,F,...",
            help="Coefficients of the root locus; from 0 to that of the scene if left out.",
        ),
    ] = None,
    slip: Annotated[
        str | None,
        typer.Option(
            metavar="VX,VY,VZ",
            help="Velocity of contactors against targets [m/s], instead of that of the start.",
        ),
    ] = None,
    stick: Annotated[
        list[str] | None, typer.Option(help="A contact that sticks; may be repeated.")
    ] = None,
    angles: Annotated[
        str | None,
        typer.Option(
            metavar="A,A,...",
            help="Angles of attack [rad] of a wheel over which growth is mapped, with --friction.",
        ),
    ] = None,
    most: Annotated[int, typer.Option(min=1, help="Refuse to look for more modes.")] = 500,
    ranks: Ranks = 1,
    oversubscribe: Oversubscribe = False,
    as_json: Json = False,
) -> None:
    """Find which modes of a sliding scene grow: complex eigenvalues, what feeds them, figures."""
    wanted: dict[str, Any] = {"top": to, "road": road, "sticking": stick or [], "most": most}
    wanted["friction"] = numbers("--friction", friction) if friction else []
    wanted["angles"] = numbers("--angles", angles) if angles else []
    if slip is not None and len(values := numbers("--slip", slip)) != 3:
        raise SceneError(f"--slip {slip!r}: expected three velocities, got {len(values)}")
    wanted["slip"] = numbers("--slip", slip) if slip else None
    checked = load(scene, changes)
    folder = out or Path("runs") / f"{checked.name}-squeal"
    if ranks > 1 and not in_mpi():
        check_start("squeal", folder, ranks, oversubscribe)
        words = ["squeal", "--to", str(to), "--road", road, "--most", str(most)]
        words += [f"--friction={friction}"] * bool(friction) + [f"--slip={slip}"] * bool(slip)
        words += [f"--stick={name}" for name in stick or []] + [f"--angles={angles}"] * bool(angles)
        raise typer.Exit(on_ranks(ranks, scene, changes, folder, as_json, tuple(words)))
    find_squeal(checked, folder, as_json, **wanted)


def numbers(option: str, text: str) -> list[float]:
    """Return the numbers of an option, parted by commas."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise SceneError(f"{option} {text!r}: expected numbers parted by commas") from None


def find_squeal(scene: Scene, folder: Path, as_json: bool, **wanted: Any) -> None:
    """Find what grows on these ranks, draw and print it; ``wanted`` as ``squeal.squeal``."""
    from mpi4py import MPI

    from workflow.squeal.figures import draw
    from workflow.squeal.squeal import printout, squeal

    root = MPI.COMM_WORLD.rank == 0
    found = squeal(scene, folder, log=progress(quiet=not root), **wanted)
    if root:
        draw(found, folder)
        answer(as_json, found.summary, lambda: printout(found.summary))
