# SPDX-License-Identifier: LGPL-3.0-or-later
"""All that the coming steps of a model depend on, as arrays by name, and back again."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import la

from workflow.energy import Energy
from workflow.moving import moves
from workflow.results import gather

if TYPE_CHECKING:
    from workflow.energy import Ledger
    from workflow.model import Model

Arrays = dict[str, npt.NDArray[Any]]


def collect(model: "Model", ledger: "Ledger", trackers: Mapping[str, Any]) -> Arrays:
    """Return the memory of a run between two steps, whole on rank 0; collective.

    Args:
        model: The model, its acceleration in place.
        ledger: Its energies so far.
        trackers: What follows the patches of each pair, on rank 0.
    """
    state, domain, comm = model.state, model.domain, model.domain.msh.comm
    fields = {"u": state.u.x.array, "v": state.v.x.array, "a": state.a.array}
    arrays = {name: gather(domain, local) for name, local in fields.items()}
    arrays["time"] = np.array([state.t, state.step])
    for name, owner, attribute in sums(model):
        arrays[f"sum/{name}"] = np.array(comm.allgather(getattr(owner, attribute)))
    if model.connections is not None:
        masses = model.connections.masses
        arrays |= {"masses/u": masses.u, "masses/v": masses.v}
        arrays["masses/sums"] = np.array([masses.dissipation, masses.work])  # alike on all ranks
    if model.drive is not None:
        arrays["drive/torque"] = np.array(model.drive.torque)
    if model.drives is not None:
        for i, carried in enumerate(model.drives.carried):
            local = np.zeros(3 * domain.owned)
            local.reshape(-1, 3)[carried.dofs] = carried.reaction
            arrays[f"driven/{i}/reaction"] = gather(domain, local)
            arrays[f"driven/{i}/centre"] = carried.centre
    sampled = {} if model.sampling is None else {"": model.sampling}
    for kind, parts in (("pair", model.pairs), ("tracker", trackers), ("samples", sampled)):
        for name, part in parts.items():
            arrays |= {f"{kind}/{name}/{key}": a for key, a in part.memory().items()}
    return arrays | energies(ledger)


def restore(model: "Model", ledger: "Ledger", arrays: Arrays) -> None:
    """Go on from what :func:`collect` returned, the same arrays on every rank; collective."""
    state, domain = model.state, model.domain
    state.u.x.array[:] = arrays["u"][domain.nodes].ravel()
    state.v.x.array[:] = arrays["v"][domain.nodes].ravel()
    state.t, state.step = float(arrays["time"][0]), int(arrays["time"][1])
    if model.connections is not None:
        masses = model.connections.masses
        masses.u[:], masses.v[:] = arrays["masses/u"], arrays["masses/v"]
        masses.dissipation, masses.work = map(float, arrays["masses/sums"])
    if "drive/torque" in arrays:
        from workflow.attachments import drive

        model.drive = drive(model, 0.0, 0.0)
        model.drive.torque = float(arrays["drive/torque"])
    if model.scene.driven or moves(model.scene):
        steer(model, arrays)
    remind(model)
    state.a.array[:] = 0.0
    state.a.array[: 3 * domain.owned] = arrays["a"][domain.nodes[: domain.owned]].ravel()
    comm: MPI.Comm = domain.msh.comm
    ranks, rank = comm.size, comm.rank
    for name, owner, attribute in sums(model):
        parts = arrays[f"sum/{name}"]
        together = float(parts.sum()) if rank == 0 else 0.0
        setattr(owner, attribute, float(parts[rank]) if len(parts) == ranks else together)
    for name, pair in model.pairs.items():
        pair.restore(part(arrays, f"pair/{name}/"))
    if model.sampling is not None:
        model.sampling.restore(part(arrays, "samples//"))
    remember(ledger, arrays)


def part(arrays: Arrays, prefix: str) -> Arrays:
    """Return the arrays whose names begin so, without the beginning."""
    return {k.removeprefix(prefix): a for k, a in arrays.items() if k.startswith(prefix)}


def steer(model: "Model", arrays: Arrays) -> None:
    """Hold driven surfaces again where they were."""
    from workflow.driven import Hold

    model.drives = Hold(model)
    for i, carried in enumerate(model.drives.carried):
        carried.centre = arrays[f"driven/{i}/centre"]
        carried.arm = carried.reference[carried.dofs] - carried.centre
        nodes = model.domain.nodes[carried.dofs]
        carried.reaction = arrays[f"driven/{i}/reaction"][nodes]


def remind(model: "Model") -> None:
    """Let every load but contact know its last force, which is that of the present state.

    They count the work between two calls, so the first call of a new one counts nothing.
    """
    force = la.vector(model.domain.V.dofmap.index_map, 3)
    contact = [pair.add for pair in model.pairs.values()]
    for add in model.loads:
        if add not in contact:
            add(model.state, force)


def sums(model: "Model") -> Iterator[tuple[str, Any, str]]:
    """Yield name, owner and attribute of everything that is summed up on each rank by itself."""
    yield "internal", model.internal, "work"
    if model.viscosity is not None:
        yield "viscosity", model.viscosity, "work"
    if model.damping is not None:
        yield "damping", model.damping, "dissipation"
    if model.drive is not None:
        yield "drive", model.drive, "work"
    if model.connections is not None:
        for i, link in enumerate(model.connections.links):
            yield f"link{i}", link, "dissipation"
    if model.drives is not None:
        for i, carried in enumerate(model.drives.carried):
            yield f"driven{i}", carried, "work"
        for i, mover in enumerate(model.drives.moved):
            yield f"moved{i}", mover, "work"
            yield f"moved{i}/reaction", mover, "reaction"


def energies(ledger: "Ledger") -> Arrays:
    """Return the memory of a ledger."""
    scalars = [ledger.ride, ledger.reference, ledger.internal_start]
    arrays = {"ledger/scalars": np.array(scalars)}
    if ledger.start is not None:
        arrays |= {f"ledger/start/{k}": np.array(e) for k, e in asdict(ledger.start).items()}
    return arrays


def remember(ledger: "Ledger", arrays: Arrays) -> None:
    """Give a ledger its memory back."""
    ledger.ride, ledger.reference, ledger.internal_start = map(float, arrays["ledger/scalars"])
    start = part(arrays, "ledger/start/")
    ledger.start = Energy(**{k: float(e) for k, e in start.items()}) if start else None
