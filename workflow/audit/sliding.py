# SPDX-License-Identifier: LGPL-3.0-or-later
"""Whether the sliding state of a scene is unstable by itself: an oscillation that is no fault.

What grows in an exact solution on this mesh is no fault of the step. Where a scene begins in
sliding, its complex eigenvalues say at what frequency and how fast; finer cells may change both.
"""

from collections.abc import Callable, Iterator
from typing import Any

from mpi4py import MPI

from workflow.scene.scene import Scene, SceneError
from workflow.simulation.guards import GuardError

CELLS = 20_000  # above which it is left to squealx squeal
MOST = 150  # modes, likewise


def slides(scene: Scene) -> bool:
    """Whether a scene has what a steady sliding state takes: rest in contact, friction, motion."""
    moves = any(b.velocity for b in scene.bodies.values()) or scene.rolling is not None
    moves = moves or bool(scene.driven) or any(s.velocity for s in scene.supports)
    rubs = any(contact.friction != 0.0 for contact in scene.contacts.values())
    return scene.equilibrium is not None and moves and rubs


def sliding_state(
    scene: Scene, cells: int, comm: MPI.Comm, log: Callable[[str], Any]
) -> dict[str, Any] | None:
    """Return what the sliding state of a scene does by itself; None if nothing slides; collective.

    Args:
        scene: The scene.
        cells: How many its mesh has.
        comm: Ranks that share it.
        log: Called with lines of progress.

    Returns:
        ``growing``, modes that grow with ``frequency`` and ``growth_rate``, fastest first, and
        ``top``, the frequency to which was looked; or ``unknown``, why it was not.
    """
    if not slides(scene):
        return None
    if cells > CELLS:
        return {"unknown": f"{cells} cells; squealx squeal {scene.name} looks for it"}
    from workflow.squeal.squeal import squeal

    log("sliding state by itself")
    try:
        found = squeal(scene, comm=comm, top=None, road="projection", most=MOST, log=log).summary
    except (SceneError, GuardError) as error:
        return {"unknown": str(error)}
    growing = [mode for mode in found["modes"] if mode["kind"] != "stable"]
    growing.sort(key=lambda mode: -mode["growth_rate"])
    kept = [{key: mode[key] for key in ("frequency", "growth_rate")} for mode in growing]
    return {"growing": kept, "top": found["top"]}


def in_words(found: dict[str, Any] | None) -> Iterator[str]:
    """Yield what is said of a sliding state."""
    if found is None:
        return
    if "unknown" in found:
        yield f"sliding state by itself: not looked for, {found['unknown']}"
    elif not found["growing"]:
        yield f"sliding state by itself: stable to {found['top'] / 1e3:.3g} kHz"
    else:
        fastest = found["growing"][0]
        yield (
            f"sliding state by itself: {fastest['frequency'] / 1e3:.3g} kHz grows by "
            f"{fastest['growth_rate']:.3g} per second, at any step; "
            f"{len(found['growing'])} of the modes to {found['top'] / 1e3:.3g} kHz grow"
        )
