# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Motion at probes and contact forces, sampled more often than there are outputs.

A sample is the mean over a window from one sample time to the next, never a value at an instant:

- velocity ``(u₁ - u₀) / T`` and acceleration ``(v₁ - v₀) / T``, which are those means exactly;
- displacement and contact force by the trapezoidal rule over the steps, so that force times ``T``
  is the momentum that goes over between the velocities ``v + dt/2 a`` at both ends.

The mean is the filter that guards against aliasing. It takes the amplitude at a frequency f to
``sinc(f T) = sin(π f T) / (π f T)``, which spectra are divided by. What is left of an oscillation
at ``1/T - f`` then shows up at f with ``f T / (1 - f T)`` of its size: 11 % at 10 kHz and
``T`` = 10 µs, less below. Steps are 1/50 of a window and less; they are filtered by no more.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from meshes.arrays import Array, Index
from meshes.domain import Domain
from meshes.quads import area_shares
from workflow.model import Model
from workflow.model.regions import facets, surface_nodes
from workflow.results.columns import Item, note, rows, whole
from workflow.results.samples import UNITS
from workflow.results.writer import Results
from workflow.scene import SceneError
from workflow.scene.settings import Probe
from workflow.simulation.rolling import spin
from workflow.simulation.stepping import due

if TYPE_CHECKING:
    from contact import ContactPair


def place(probe: Probe, domain: Domain, mass: Array) -> tuple[Index, Array]:
    """Return the nodes of a probe and their shares in its mean, which sum to 1.

    Args:
        probe: The probe.
        domain: The mesh.
        mass: Lumped mass of every mesh node, shape ``(n,)`` [kg].
    """
    source = domain.source
    if probe.surface is not None:
        nodes = surface_nodes(domain, probe.surface)
    elif probe.region is not None:
        nodes = source.nodes(source.tag(probe.region))
    else:
        nodes = np.unique(source.cells)
    if probe.point is not None:
        away = np.linalg.norm(source.points[nodes] - probe.point, axis=1)
        return nodes[[int(np.argmin(away))]], np.ones(1)
    if probe.surface is not None:
        return area_shares(domain.source.points, facets(domain, probe.surface))
    return nodes, mass[nodes] / mass[nodes].sum()


class Window:
    """The window that samples are means over.

    Attributes:
        every: First steps in it.
        interval: Its length [s].
        weight: The present step over the first [-].
    """

    def __init__(self, model: Model, interval: float) -> None:
        unit = model.dt if model.span is None else model.span
        steps = 1 if model.span is None else round(model.span / model.dt)
        self.every = steps * max(1, round(interval / unit))
        self.interval, self.weight, self.first = self.every * model.dt, 1.0, model.dt


class ProbeSampler:
    """One probe: means of its motion over windows, this rank's part.

    Attributes:
        nodes: Its mesh nodes.
    """

    def __init__(self, probe: Probe, model: Model, mass: Array) -> None:
        self.probe, self.state, self.dt = probe, model.state, model.dt
        self.nodes, share = place(probe, model.domain, mass)
        local = model.domain.local_dofs(self.nodes)
        self.index = 3 * local[local >= 0].astype(np.int64)[:, None] + np.arange(3)
        self.share = share[local >= 0]
        self.sum, self.start = np.zeros(3), np.zeros(3)
        self.every_step = probe.quantity == "displacement"

    def now(self) -> Array:
        """Return what the mean is made of: displacement, or velocity at t [m, m/s]."""
        state, index = self.state, self.index
        if self.probe.quantity == "acceleration":
            v = state.v.x.array.take(index) + self.dt / 2 * state.a.array.take(index)
            return np.asarray(self.share @ v)
        return np.asarray(self.share @ state.u.x.array.take(index))

    def follow(self, weight: float) -> None:
        """Take the present step into the window, a mean by the trapezoidal rule."""
        if self.every_step:
            self.sum += weight * self.now()

    def close(self, window: "Window") -> Array:
        """Return the mean over the window that ends now, and begin the next, shape ``(3,)``."""
        if self.every_step:
            mean = (self.sum + window.weight * self.now() / 2) / window.every
            self.begin(window)
            return np.asarray(mean)
        before = self.start
        self.start = self.now()
        return (self.start - before) / window.interval

    def begin(self, window: "Window") -> None:
        """Begin a window now."""
        now = self.now()
        self.start, self.sum = now, window.weight * now / 2


class ContactSampler:
    """The forces of one contact pair: means over windows, alike on all ranks, kept on rank 0.

    Attributes:
        pair: The contact pair.
        total: Sums of normal and tangential force on the contactor, shape ``(2, 3)`` [N].
        nodal: The same of every contactor node, shape ``(nc, 6)`` [N].
    """

    def __init__(self, pair: "ContactPair") -> None:
        self.pair, self.side = pair, pair.passes[0]
        self.total = np.zeros((2, 3))
        self.nodal = np.zeros((len(self.side.contactor.nodes), 6))

    def now(self) -> tuple[Array, npt.NDArray[np.int32], Array]:
        """Return the total, the touching nodes (first pass) and their forces at this step."""
        touching, force = self.side.forces()
        total = np.array([self.pair.normal_resultant, self.pair.tangential_force])
        return total, touching, force

    def follow(self, weight: float) -> None:
        """Take the present step into the window."""
        total, touching, force = self.now()
        if weight != 1.0:
            total *= weight
            force *= weight
        self.total += total
        self.nodal[touching] += force

    def close(self, window: "Window") -> tuple[Array, Index, Array]:
        """Return the means over the window that ends now, and begin the next.

        Total ``(2, 3)`` [N]; mesh nodes that touched ``(m,)`` and their forces ``(m, 6)`` [N].
        """
        self.follow(window.weight / 2)
        touched = np.flatnonzero(self.nodal.any(axis=1))
        nodes = self.side.contactor.nodes[touched]
        means = self.total / window.every, nodes, self.nodal[touched] / window.every
        self.begin(window)
        return means

    def begin(self, window: "Window") -> None:
        """Begin a window now."""
        self.total[:] = 0.0
        self.nodal[:] = 0.0
        self.follow(window.weight / 2)


class Sampling:
    """Samples probes and contact pairs of a run; all ranks call it alike.

    Attributes:
        window: What the samples are means over.
        written: Samples that are in the results already.
    """

    def __init__(self, model: Model) -> None:
        scene, domain = model.scene, model.domain
        assert scene.output.sample_interval is not None
        self.window = Window(model, scene.output.sample_interval)
        self.model, self.written, self.open = model, 0, False
        comm = domain.msh.comm
        mass = np.zeros(len(domain.source.points))
        if any(p.region is not None and p.point is None for p in scene.probes):
            mass[domain.nodes[: domain.owned]] = model.mass.array[::3][: domain.owned]
            mass = comm.allreduce(mass)
        self.probes = [ProbeSampler(probe, model, mass) for probe in scene.probes]
        self.contacts = (
            {n: ContactSampler(p) for n, p in model.pairs.items()} if comm.rank == 0 else {}
        )
        self.busy = [g for g in self.probes if g.every_step]
        self.clear()

    def clear(self) -> None:
        """Forget the samples that wait to be written."""
        self.t: list[float] = []
        self.motion: list[Array] = []
        self.force: dict[str, list[tuple[Array, Index, Array]]] = {n: [] for n in self.contacts}

    def lines(self) -> list[str]:
        """Say what is sampled, for the log."""
        points, window = self.model.domain.source.points, self.window
        told = [f"sampled: means over {window.every} steps, {window.interval * 1e6:.3f} us"]
        for sampler in self.probes:
            probe, n = sampler.probe, len(sampler.nodes)
            where = f"mean of the {n} nodes of {probe.surface or probe.region}"
            if probe.point is not None:
                at = points[sampler.nodes[0]]
                off = np.linalg.norm(at - probe.point)
                x, y, z = at
                where = f"node {sampler.nodes[0]} at x = {x:.5f}, y = {y:.5f}, z = {z:.5f} m"
                where += f", {off:.1e} m from the point given"
            told.append(f"probe {probe.name}: {probe.quantity} of {where}")
        return told

    def step(self) -> None:
        """Take in the present step, its forces in place; close the window if it is full."""
        window = self.window
        edge = due(self.model.state.t, window.interval, self.model.dt)
        if edge and self.open:
            self._close()
        elif edge:
            for sampler in self.probes:
                sampler.begin(window)
            for contact in self.contacts.values():
                contact.begin(window)
            self.open = True
        elif self.open:
            self._take(window.weight)

    def retime(self, dt: float) -> None:
        """Go on with another step from the present state, half of whose weight it is [s]."""
        weight = dt / self.window.first
        self._take((weight - self.window.weight) / 2 if self.open else 0.0)
        self.window.weight = weight
        for sampler in self.probes:
            sampler.dt = dt

    def _take(self, weight: float) -> None:
        """Take the present state into the open windows."""
        for sampler in self.busy:
            sampler.follow(weight)
        for contact in self.contacts.values():
            contact.follow(weight)

    def _close(self) -> None:
        window = self.window
        self.t.append(self.model.state.t - window.interval / 2)
        if self.probes:
            self.motion.append(np.array([sampler.close(window) for sampler in self.probes]))
        for name, contact in self.contacts.items():
            self.force[name].append(contact.close(window))

    def append(self, results: Results) -> None:
        """Add to the results what was sampled since the last time; collective, as an output."""
        arrays = self.take()
        if results.comm.bcast(len(arrays["t"])):
            results.add(lambda: _record(self, arrays))

    def take(self) -> dict[str, npt.NDArray[Any]]:
        """Return the waiting samples by name, whole on rank 0, and count them as written.

        ``t`` (k,), ``motion`` (k, probes, 3), and of each pair ``PAIR/total`` (k, 2, 3),
        ``PAIR/count`` (k,) nodes of each sample, ``PAIR/node`` and ``PAIR/nodal`` (m, 6).
        """
        whole = self._waiting()
        comm = self.model.domain.msh.comm
        if self.probes:
            parts = comm.gather(whole["motion"])
            whole["motion"] = sum(parts[1:], parts[0]) if parts else whole["motion"]
        self.written += len(self.t)
        self.clear()
        return whole

    def _waiting(self) -> dict[str, npt.NDArray[Any]]:
        """Return what waits by name, this rank's part of the motion."""
        arrays: dict[str, npt.NDArray[Any]] = {"t": np.array(self.t)}
        arrays["motion"] = np.array(self.motion).reshape(len(self.t), len(self.probes), 3)
        for name, means in self.force.items():
            total, nodes, nodal = zip(*means, strict=True) if means else ((), (), ())
            arrays[f"{name}/total"] = np.array(total).reshape(-1, 2, 3)
            arrays[f"{name}/count"] = np.array([len(n) for n in nodes], dtype=np.int64)
            arrays[f"{name}/node"] = np.concatenate([np.zeros(0, dtype=np.int64), *nodes])
            arrays[f"{name}/nodal"] = np.concatenate([np.zeros((0, 6)), *nodal])
        return arrays

    # ---- memory ---------------------------------------------------------------------------

    def memory(self) -> dict[str, npt.NDArray[Any]]:
        """Return all that coming samples depend on, whole on rank 0; collective."""
        comm, waiting = self.model.domain.msh.comm, self._waiting()
        starts = np.array([[g.start, g.sum] for g in self.probes]).reshape(-1, 2, 3)
        waiting["motion"], waiting["start"] = (
            np.array(comm.allgather(part)) for part in (waiting["motion"], starts)
        )
        for name, contact in self.contacts.items():
            waiting |= {f"{name}/sum": contact.total.copy(), f"{name}/sums": contact.nodal.copy()}
        return waiting | {"every": np.array([self.window.every, self.written, self.open])}

    def restore(self, memory: dict[str, npt.NDArray[Any]]) -> None:
        """Go on from what :meth:`memory` returned, the same on every rank; any number of ranks.

        Raises:
            SceneError: if the windows have another length now.
        """
        if not memory:  # sampling begins here
            return
        every, self.written, opened = map(int, memory["every"])
        if every != self.window.every:
            raise SceneError(
                f"output.sample_interval: {self.window.every} steps, expected {every} as in the "
                "checkpoint; a run that is resumed keeps its interval or leaves it out"
            )
        self.open, self.t = bool(opened), list(memory["t"])
        self.window.weight = self.model.dt / self.window.first
        comm = self.model.domain.msh.comm
        motion, start = (self._mine(memory[key], comm) for key in ("motion", "start"))
        self.motion = list(motion) if self.probes else []
        for sampler, (before, sums) in zip(self.probes, start, strict=True):
            sampler.dt = self.model.dt
            sampler.start, sampler.sum = before.copy(), sums.copy()
        for name, contact in self.contacts.items():
            contact.total[:], contact.nodal[:] = memory[f"{name}/sum"], memory[f"{name}/sums"]
            cuts = np.cumsum(memory[f"{name}/count"])[:-1]
            nodes, nodal = (np.split(memory[f"{name}/{key}"], cuts) for key in ("node", "nodal"))
            self.force[name] = list(zip(memory[f"{name}/total"], nodes, nodal, strict=False))

    @staticmethod
    def _mine(parts: npt.NDArray[Any], comm: Any) -> npt.NDArray[Any]:
        """Return this rank's part; on other ranks than before, rank 0 has them all."""
        if len(parts) == comm.size:
            return np.asarray(parts[comm.rank])
        whole = parts.sum(axis=0)
        return whole if comm.rank == 0 else np.zeros_like(whole)


def _record(sampling: Sampling, arrays: dict[str, npt.NDArray[Any]]) -> Iterator[Item]:
    """Yield samples as they go into a results file."""
    about = "means over windows of that length [s], t in their middle"
    yield note("probes", interval=sampling.window.interval, about=about, **_rolling(sampling))
    yield rows("probes/t", arrays["t"], "s")
    points = sampling.model.domain.source.points
    for i, sampler in enumerate(sampling.probes):
        name, kind, nodes = sampler.probe.name, sampler.probe.quantity, sampler.nodes
        yield rows(
            f"probes/motion/{name}",
            arrays["motion"][:, i],
            UNITS[kind],
            quantity=kind,
            nodes=len(nodes),
            place=points[nodes].mean(axis=0).tolist(),
            body=body_of(sampling, int(nodes[0])),
        )
    for name in sampling.contacts:
        group = f"probes/contact/{name}"
        if sampling.written == len(arrays["t"]):  # the first ones
            yield from _surface(group, sampling, name)
        total, nodal = arrays[f"{name}/total"], arrays[f"{name}/nodal"].astype(np.float32)
        yield rows(f"{group}/normal_force", total[:, 0], "N")
        yield rows(f"{group}/tangential_force", total[:, 1], "N")
        yield rows(f"{group}/nodal/count", arrays[f"{name}/count"], "1")
        yield rows(f"{group}/nodal/node", arrays[f"{name}/node"].astype(np.int32), "1")
        yield rows(f"{group}/nodal/normal_force", nodal[:, :3], "N")
        yield rows(f"{group}/nodal/tangential_force", nodal[:, 3:], "N")


def _rolling(sampling: Sampling) -> dict[str, Any]:
    """Return how the wheelset turns, so that forces can be brought into its own axes."""
    model = sampling.model
    if model.scene.rolling is None:
        return {}
    centre = np.asarray(model.placement.centre, dtype=np.float64)
    return {"spin": spin(model).tolist(), "centre": centre.tolist()}


def _surface(group: str, sampling: Sampling, pair: str) -> Iterator[Item]:
    """Yield body, nodes and reference positions of the contactor of a pair."""
    contactor = sampling.contacts[pair].side.contactor
    order = np.argsort(contactor.nodes)
    yield note(group, body=body_of(sampling, int(contactor.nodes[0])))
    yield whole(f"{group}/surface/node", contactor.nodes[order].astype(np.int32))
    places = sampling.model.domain.source.points[contactor.nodes[order]]
    yield whole(f"{group}/surface/place", places)


def body_of(sampling: Sampling, node: int) -> str:
    """Return the name of the body that a mesh node belongs to."""
    mesh, bodies = sampling.model.domain.source, sampling.model.scene.bodies
    region = mesh.name(int(mesh.regions[(mesh.cells == node).any(axis=1)][0]))
    return next(n for n, b in bodies.items() if region in [r.lower() for r in b.regions])
