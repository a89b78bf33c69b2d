# SPDX-License-Identifier: LGPL-3.0-or-later
"""Residual state: the history and unloaded shape that a run leaves, from which a pass begins.

Bodies that rolled, were driven or flew are moved back to where they started. Loads and contact are
taken off in elastic steps from the end of the run, which also ends its vibrations: what is left are
the shape and the stress that the history asks for.
"""

import json
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem, la

from forms.memory import EQUIVALENT
from meshes.arrays import Array, Index
from meshes.rotation import nearest_rotation
from workflow.model import Model
from workflow.model.memory import STRESS, MemoryForce
from workflow.model.regions import surface_nodes
from workflow.model.residual import FILE, before
from workflow.results import atomic
from workflow.results.folder import on_root
from workflow.results.passes import write_section
from workflow.scene import Scene, SceneError
from workflow.scene.settings import Equilibrium
from workflow.simulation.at_rest import held_dofs
from workflow.simulation.checkpoint import mesh_hash
from workflow.simulation.elastic import Elastic

STEPS = 3  # of unloading
XZ = 5  # place of a shear in VTK's six numbers of a tensor


def leave(model: Model, folder: Path) -> None:
    """Write the residual state of a run at its end, and its depth profile; collective.

    The state of the model is left as it is.
    """
    u, v = model.state.u.x.array.copy(), model.state.v.x.array.copy()
    model.state.v.x.array[:] = 0.0
    put_back(model)
    unload(model)
    shape, comm = model.domain.gather(model.state.u.x.array), model.domain.msh.comm
    arrays: dict[str, npt.NDArray[Any]] = {"u": shape}
    for item in remembering(model):
        arrays |= {f"{item.name}/{key}": value for key, value in item.memory().items()}
    place = section_of(model)
    profile = depth_profile(model, place)
    about = {"mesh": mesh_hash(model.domain.source), "section": place}
    model.state.u.x.array[:], model.state.v.x.array[:] = u, v

    def write() -> None:
        arrays["about"] = np.frombuffer(json.dumps(about).encode(), dtype=np.uint8)
        content = BytesIO()
        np.savez(content, **arrays)  # type: ignore[arg-type]
        atomic.replace(folder / FILE, content.getvalue())
        write_section(folder, profile)

    on_root(comm, folder, write)


def take(model: Model) -> None:
    """Begin with the residual state that a scene names, if it names one; collective.

    Raises:
        SceneError: on all ranks, if it is that of another mesh or other bodies, or if there is
            nothing below the section.
    """
    check_section(model)
    folder = before(model.scene)
    if folder is None:
        return
    about, arrays = read(model, folder)
    told = f"passes.after = {str(folder)!r}"
    if about["mesh"] != mesh_hash(model.domain.source):
        raise SceneError(f"{told}: expected a run on the same mesh")
    for item in remembering(model):
        history = item.points.history
        values = arrays.get(f"{item.name}/history")
        if values is None or values.shape[1:] != (history.points, history.size):
            raise SceneError(f"{told}: expected the law of bodies.{item.name} to be the same there")
        item.restore({"cells": arrays[f"{item.name}/cells"], "history": values})
    shape = arrays["u"][model.domain.nodes].ravel()
    model.state.u.x.array[:] = shape
    model.left = fem.Function(model.domain.V)
    model.left.x.array[:] = shape


def read(model: Model, folder: Path) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
    """Return what a residual state tells of itself, and its arrays, on all ranks.

    Raises:
        SceneError: on all ranks, if it cannot be read.
    """
    comm, found, error = model.domain.msh.comm, None, None
    if comm.rank == 0:
        try:
            with np.load(folder / FILE) as file:
                arrays = dict(file)
            found = dict(json.loads(arrays.pop("about").tobytes())), arrays
        except Exception as caught:  # a file can be broken in more ways than numpy has errors for
            error = str(caught) or type(caught).__name__
    found, error = comm.bcast((found, error))
    if found is None:
        raise SceneError(f"passes.after = {str(folder)!r}: {FILE} cannot be read: {error}")
    return found


def remembering(model: Model) -> list[MemoryForce]:
    """Return the internal forces of bodies whose material has a memory."""
    return [item for item in model.items if isinstance(item, MemoryForce)]


def moving(scene: Scene) -> list[str]:
    """Return the bodies that start from a place of their own: rolling, driven, flying, brought."""
    rolling = [scene.rolling.body] if scene.rolling else []
    flying = [name for name, body in scene.bodies.items() if body.velocity is not None]
    brought = [*scene.equilibrium.approach] if scene.equilibrium else []
    return sorted({*rolling, *scene.driven, *flying, *brought})


def put_back(model: Model) -> None:
    """Move bodies back to where they started, in place; those without a memory whole; collective.

    What carries a driven body is rigid and tells how it moved; else it is the whole body.
    """
    scene, domain, state = model.scene, model.domain, model.state
    mesh, u = domain.source, domain.msh.comm.bcast(domain.gather(state.u.x.array))
    with_memory = {item.name for item in remembering(model)}
    for name in moving(scene):
        nodes = mesh.nodes(*mesh.tags(scene.bodies[name].regions))
        if name not in with_memory:
            u[nodes] = 0.0
            continue
        driven = scene.driven.get(name)
        rigid = nodes if driven is None else surface_nodes(domain, driven.surface)
        u[nodes] = deformation(mesh.points, u, rigid, nodes)
    state.u.x.array[:] = u[domain.nodes].ravel()


def deformation(points: Array, u: Array, rigid: Index, nodes: Index) -> Array:
    """Return the displacement of nodes less the rigid motion that fits others best.

    Args:
        points: Places of all nodes, shape ``(n, 3)`` [m].
        u: Their displacement, shape ``(n, 3)`` [m].
        rigid: Nodes whose motion is taken, shape ``(k,)``.
        nodes: Nodes whose displacement is wanted, shape ``(m,)``.
    """
    X, x = points[rigid], points[rigid] + u[rigid]
    before, after = X.mean(axis=0), x.mean(axis=0)
    turned_back = (points[nodes] + u[nodes] - after) @ nearest_rotation(X, x)
    return np.asarray(turned_back + before - points[nodes])


def unload(model: Model) -> None:
    """Take loads and contact off in elastic steps from the present state, in place; collective.

    At small strain the first is exact but for what anchors bodies that only contact holds; the
    others take away what is left. Steel is not to yield again as it is unloaded.
    """
    state, index_map = model.state, model.domain.V.dofmap.index_map
    force, du = la.vector(index_map, 3), la.vector(index_map, 3)
    elastic = Elastic(model, held_dofs(model, model.scene.equilibrium or Equilibrium()))
    n = 3 * model.domain.owned
    for _ in range(STEPS):
        force.array[:] = 0.0
        for item in model.items:
            if hasattr(item, "stored") or item is model.connections:
                item.rest(state, force)
        force.scatter_reverse(la.InsertMode.add)
        elastic.solve(force, du)
        state.u.x.array[:n] += du.array[:n]
        state.u.x.scatter_forward()


def section_of(model: Model) -> list[float]:
    """Return x and y of the depth profile: as the scene or the runs before say [m]; collective.

    Else those of the cell that has strained most.
    """
    passes = model.scene.passes
    assert passes is not None
    if passes.section is not None:
        return list(passes.section)
    if (folder := before(model.scene)) is not None:
        return list(read(model, folder)[0]["section"])
    strain = equivalent_strains(model)
    mesh, place = model.domain.source, None
    if model.domain.msh.comm.rank == 0:
        place = mesh.points[mesh.cells[int(strain.argmax())]].mean(axis=0)[:2].tolist()
    return list(model.domain.msh.comm.bcast(place))


def equivalent_strains(model: Model) -> Array:
    """Return the mean equivalent plastic strain of all cells on rank 0; collective."""
    root = model.domain.msh.comm.rank == 0
    strain = np.zeros(len(model.domain.source.cells) if root else 0)
    for item in remembering(model):
        if EQUIVALENT in item.cell_fields:
            strain += item.cell_means(EQUIVALENT)
    return strain


def depth_profile(model: Model, place: list[float]) -> dict[str, Array]:
    """Return columns of the cells below a place, from the top down, on rank 0; collective.

    Args:
        model: The model in its residual state.
        place: x and y [m].
    """
    mesh, items = model.domain.source, remembering(model)
    p = equivalent_strains(model)
    strains = [item.cell_plastic_strain() for item in items]
    stresses = [np.nan_to_num(item.cell_means(STRESS)) for item in items]
    if model.domain.msh.comm.rank or not items:
        return {}
    strain, stress = np.sum(strains, axis=0), np.sum(stresses, axis=0)
    below = cells_below(model, place)
    z = mesh.points[mesh.cells[below], 2]
    return {
        "depth": z.max() - z.mean(axis=1),
        "equivalent_plastic_strain": p[below],
        "plastic_shear_xz": 2 * strain[below, XZ],
        "stress_xx": stress[below, 0],
        "stress_yy": stress[below, 1],
        "stress_zz": stress[below, 2],
        "stress_xz": stress[below, XZ],
    }


def cells_below(model: Model, place: list[float]) -> Index:
    """Return the cells with a memory below x and y of a place [m], from the top down."""
    mesh, names = model.domain.source, [item.name for item in remembering(model)]
    tags = [tag for name in names for tag in mesh.tags(model.scene.bodies[name].regions)]
    corners = mesh.points[mesh.cells]
    low, high = corners.min(axis=1)[:, :2], corners.max(axis=1)[:, :2]
    inside = ((low <= place) & (place < high)).all(axis=1)
    below = np.flatnonzero(inside & np.isin(mesh.regions, tags))
    return below[np.argsort(-corners[below, :, 2].mean(axis=1), kind="stable")]


def check_section(model: Model) -> None:
    """Raise ``SceneError`` if no cell that keeps a memory lies below the section of a scene."""
    place = model.scene.passes.section if model.scene.passes else None
    if place is not None and remembering(model) and not len(cells_below(model, list(place))):
        raise SceneError(
            f"passes.section = {list(place)}: expected x and y of a place below which there are "
            "cells of a material with a memory [m]"
        )
