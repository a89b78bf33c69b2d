# SPDX-License-Identifier: LGPL-3.0-or-later
"""Candidates of contact near the patch, and when to search for them again."""

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from contact._kernel import lib
from contact.arrays import Index32, view
from contact.contact_state import ContactState
from contact.exchange import Exchange
from contact.search import Found, Search, typical_edge
from contact.surface import Surface
from meshes.arrays import Array

if TYPE_CHECKING:
    from mpi4py import MPI

# Between two searches nodes may gain speed. Every 16 steps all of them are measured: while the
# largest ways of both surfaces together are below the margin, no node can have arrived unseen.
_WATCH = 16
_LONGEST_INTERVAL = 500
_SPEED_RESERVE = 1.5
_DEEP = 4.0  # common edges to which a static solve may press nodes into the target
_COMMON = 30.0  # percentile of edge lengths that a strip of small cells does not reach


class Candidates:
    """Candidates of a pass, kept so that no node can touch the target before it is one.

    Attributes:
        stack: Numbers of the nodes.
        search, exchange: What finds the candidates, and what brings their positions.
        found: Result of the last search.
        margin: Distance within which a node is a candidate [m].
        reach: Deepest penetration at which contact can begin [m].
    """

    def __init__(
        self,
        contactor: Surface,
        target: Surface,
        comm: "MPI.Comm | None",
        reach: float | None,
        name: str,
        smooth_below: float | None = None,
        points_below: float | None = None,
    ) -> None:
        """Prepare the search; arguments as for :class:`contact.pair.ContactPair`."""
        self.name = name
        self.search = Search(contactor, target, smooth_below, points_below, comm)
        self.stack = stack = self.search.stack
        self.exchange = Exchange(stack, comm, self.search.points)
        fine = target if contactor.rigid else contactor
        cell = typical_edge(fine)
        self.reach = 0.5 * cell if reach is None else float(reach)
        if not (self.reach > 0.0 and np.isfinite(self.reach)):
            raise ValueError(f"reach: expected a positive length, got {reach} m")
        self._wide = max(cell, typical_edge(fine, _COMMON), self.reach)
        # with a strip of small cells searches must not be frequent, nor candidates many
        self.margin = max((cell * self._wide) ** 0.5, self.reach)
        self.forget()

    def forget(self) -> None:
        """Drop all candidates; the next step searches."""
        self._steps_left, self._searched = 0, False
        self._watch_left, self._way = _WATCH, 0.0
        self._choose(self.search.nothing())

    @property
    def item(self) -> Index32:
        """Contactor nodes that may touch, ascending, shape ``(k,)``."""
        return self.found.item

    def approach(self, u: Array, v: Array, dt: float, state: ContactState) -> None:
        """Read the candidates, and search again before any other node can arrive."""
        self._steps_left -= 1
        self._watch_left -= 1
        due = self._steps_left < 0 or not 2.0 * self.exchange.update(u, v) < self.margin
        way = 0.0
        if self._searched and (due or self._watch_left <= 0):
            way = self.exchange.wandered(u, v)
            gain, self._way, self._watch_left = way - self._way, way, _WATCH
            due = due or not way + 2.0 * gain < self.margin
        if due:
            self.exchange.whole(u, v)
            if way > self.margin:
                self._check_unseen(way)
            self._find(state, self.margin, self.reach)
            self._steps_left = self._safe_steps(dt) - 1

    def _check_unseen(self, way: float) -> None:
        """Raise RuntimeError if a node that was no candidate is in the target already.

        Args:
            way: How far nodes have come closer since the last search, more than the margin [m].
        """
        depth, c = self._deepest(way)
        if depth > 0.0 and c not in self.item:
            raise RuntimeError(
                f"contact pair {self.name}: node {self.stack.node[c]} was not watched and is "
                f"{depth:.3e} m deep; nodes have come closer by {way:.3e} m since the last "
                f"search, the margin is {self.margin:.3e} m"
            )

    def update_static(self, u: Array, state: ContactState) -> None:
        """Read a state at rest, and search again if anything moved far.

        On its way to rest a solver may press bodies far into each other: nodes count to a depth of
        :data:`_DEEP` common edges.
        """
        if not (2.0 * self.exchange.whole(u, u) < self._wide and self._searched):
            self._find(state, self._wide, _DEEP * self._wide, at_rest=True)
        self._steps_left = 0

    def track(self, xv: Any, state: ContactState) -> None:
        """Follow the closest points at the positions in the view ``xv``."""
        self.search.bend(self.found, xv)
        self.follow(xv, state)

    def follow(self, xv: Any, state: ContactState) -> None:
        """Do so on a smooth target as curved as it was last."""
        self.search.track(self.found, xv, state)

    def probe(self, above: float, below: float) -> tuple[Found, ContactState]:
        """Return what a search with nothing in contact finds at the positions last read.

        Args:
            above: Distance outside the target up to which a node counts [m].
            below: Depth inside it [m].

        Returns:
            Candidates and their closest points, gaps and normals.
        """
        state = ContactState(self.search.nc)
        found = self.search.candidates(self.exchange.xv, above, below, state)
        state.facet[found.item], state.xi[found.item] = found.facet, found.xi
        self.search.bend(found, self.exchange.c_xv)
        self.search.track(found, self.exchange.c_xv, state)
        return found, state

    def deepest(self, u: Array, reach: float | None) -> tuple[float, int]:
        """Return depth [m] and index of the deepest contactor node; (0, -1) without overlap.

        Args:
            u: Displacement, flat [m].
            reach: Depth up to which overlap is looked for [m]; a cell if None.
        """
        self.exchange.whole(u, u)
        return self._deepest(2.0 * self.reach if reach is None else reach)

    def _deepest(self, reach: float) -> tuple[float, int]:
        found, state = self.probe(reach, reach)
        if not found.item.size or not state.gap[found.item].min() < 0.0:
            return 0.0, -1
        worst = int(found.item[np.argmin(state.gap[found.item])])
        return float(-state.gap[worst]), worst

    def _find(
        self, state: ContactState, above: float, below: float, *, at_rest: bool = False
    ) -> None:
        xv = self.exchange.xv
        if not np.isfinite(xv).all():
            bad = int(np.flatnonzero(~np.isfinite(xv).all(axis=1))[0])
            where = f"{xv[bad, :3]} m, {xv[bad, 3:]} m/s"
            raise RuntimeError(
                f"contact pair {self.name}: node {self.stack.node[bad]} is at {where}"
            )
        found = self.search.candidates(xv, above, below, state)
        state.facet[found.item], state.xi[found.item] = found.facet, found.xi
        held = state.stiffness > 0.0
        held[found.item] = False
        gone = np.flatnonzero(held)
        deep = gone[state.gap[gone] < -0.5 * above]
        # on the way to rest bodies may part at once by more than their overlap
        if deep.size and not at_rest:
            raise RuntimeError(
                f"contact pair {self.name}: node {self.stack.node[deep[0]]} went through the "
                f"target (gap {state.gap[deep[0]]:.3e} m, reach {self.reach:.3e} m)"
            )
        state.release(gone)
        self._choose(found)
        self._searched = True
        self._watch_left, self._way = _WATCH, 0.0
        self.exchange.mark()

    def _safe_steps(self, dt: float) -> int:
        """Return how many steps no node outside the margin can arrive in."""
        xv, nc, target = self.exchange.xv, self.search.nc, self.stack.target
        mean = view("mean", xv[target, 3:].mean(axis=0), (3,))
        fastest = sum(
            lib.wr_fastest(len(a), view("xv", a, (-1, 6)), mean) for a in (xv[:nc], xv[target])
        )
        steps = self.margin / max(_SPEED_RESERVE * fastest * dt, 1e-300)
        return max(1, int(min(steps, _LONGEST_INTERVAL)))

    def _choose(self, found: Found) -> None:
        self.found = found
        self.exchange.choose(found.nodes)

    def saved(self) -> dict[str, npt.NDArray[Any]]:
        """Return what the coming steps depend on, as arrays by name."""
        return {
            "item": self.found.item.copy(),
            "live": self.found.live.copy(),
            "outward": self.found.outward.copy(),
            "past": self.exchange.past.copy(),
            "schedule": np.array([self._steps_left, self._searched, self._watch_left, self._way]),
        }

    def load(self, memory: dict[str, npt.NDArray[Any]], state: ContactState) -> None:
        """Take over what :meth:`saved` returned, with the contact state of then."""
        item = np.array(memory["item"], dtype=np.int32)
        live, outward = np.array(memory["live"], dtype=np.uint8), np.array(memory["outward"])
        self._choose(self.search.found(item, state.facet, state.xi, live, outward))
        self.exchange.past[:] = memory["past"]
        steps, searched, watch, self._way = memory["schedule"]
        self._steps_left, self._searched, self._watch_left = int(steps), bool(searched), int(watch)
