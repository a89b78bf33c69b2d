# SPDX-License-Identifier: LGPL-3.0-or-later
"""The part of a contact pair near the patch: who may touch, and when to look again."""

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from contact.arrays import view
from contact.contact_state import ContactState
from contact.exchange import Exchange
from contact.overlap import deepest
from contact.search import Search, typical_edge
from contact.surface import Surface

if TYPE_CHECKING:
    from mpi4py import MPI

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int32]

# Between two searches nodes may gain speed. Every 16 steps all of them are measured: while the
# largest ways of both surfaces together are below the margin, no node can have arrived unseen.
_WATCH = 16
_LONGEST_INTERVAL = 500
_SPEED_RESERVE = 1.5


class Candidates:
    """Candidates of a pair, kept so that no node can touch the target before it is one.

    Attributes:
        search, exchange: What finds the candidates, and what brings their positions.
        item: Contactor nodes that may touch, ascending, shape ``(k,)``.
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
    ) -> None:
        """Prepare the search; arguments as for :class:`contact.pair.ContactPair`."""
        self.name = name
        self.nodes = np.concatenate([contactor.nodes, target.nodes])
        self.search = Search(contactor, target, smooth_below)
        self.exchange = Exchange(
            np.vstack([contactor.reference, target.reference]),
            np.concatenate([contactor.dofs, target.dofs]),
            comm,
        )
        cell = typical_edge(target if contactor.rigid else contactor)
        self.reach = 0.5 * cell if reach is None else float(reach)
        if not (self.reach > 0.0 and np.isfinite(self.reach)):
            raise ValueError(f"reach: expected a positive length, got {reach} m")
        self.margin = max(cell, self.reach)
        self.forget()

    def forget(self) -> None:
        """Drop all candidates; the next step searches."""
        self.search.live[:] = 0
        self._steps_left, self._searched = 0, False
        self._watch_left, self._way = _WATCH, 0.0
        self._choose(np.empty(0, dtype=np.int32))

    def approach(self, u: Array, v: Array, dt: float, contact_state: ContactState) -> None:
        """Read the candidates, and search again before any other node can arrive."""
        self._steps_left -= 1
        self._watch_left -= 1
        due = self._steps_left < 0 or not 2.0 * self.exchange.update(u, v) < self.margin
        way = 0.0
        if self._searched and (due or self._watch_left <= 0):
            way = self.exchange.wandered(u, v, self.search.nc)
            gain, self._way, self._watch_left = way - self._way, way, _WATCH
            due = due or not way + 2.0 * gain < self.margin
        if due:
            self.exchange.whole(u, v)
            if way > self.margin:
                self._check_unseen(way)
            self._find(contact_state)
            self._steps_left = self._safe_steps(dt) - 1

    def _check_unseen(self, way: float) -> None:
        """Raise RuntimeError if a node that was no candidate is in the target already.

        Args:
            way: How far nodes have come closer since the last search, more than the margin [m].
        """
        depth, c = deepest(self.search, self.exchange.xv, way)
        if depth > 0.0 and c not in self.item:
            raise RuntimeError(
                f"contact pair {self.name}: node {self.nodes[c]} was not watched and is "
                f"{depth:.3e} m deep; nodes have come closer by {way:.3e} m since the last "
                f"search, the margin is {self.margin:.3e} m"
            )

    def update_static(self, u: Array, contact_state: ContactState) -> None:
        """Read a state at rest, and search again if anything moved far."""
        if not (2.0 * self.exchange.whole(u, u) < self.margin and self._searched):
            self._find(contact_state)
        self._steps_left = 0

    def deepest(self, u: Array, reach: float | None) -> tuple[float, int]:
        """Return depth [m] and index of the deepest contactor node, see :mod:`contact.overlap`."""
        self.exchange.whole(u, u)
        look = 2.0 * self.reach if reach is None else reach
        live, outward = self.search.live.copy(), self.search.outward.copy()
        answer = deepest(self.search, self.exchange.xv, look)
        self.search.live[:], self.search.outward[:] = live, outward
        self.search.neighbourhood(self.item)
        return answer

    def _find(self, contact_state: ContactState) -> None:
        xv = self.exchange.xv
        if not np.isfinite(xv).all():
            bad = int(np.flatnonzero(~np.isfinite(xv).all(axis=1))[0])
            where = f"{xv[bad, :3]} m, {xv[bad, 3:]} m/s"
            raise RuntimeError(f"contact pair {self.name}: node {self.nodes[bad]} is at {where}")
        item = self.search.candidates(
            xv,
            self.margin,
            self.reach,
            contact_state.stiffness,
            contact_state.facet,
            contact_state.xi,
        )
        held = contact_state.stiffness > 0.0
        held[item] = False
        gone = np.flatnonzero(held)
        deep = gone[contact_state.gap[gone] < -0.5 * self.margin]
        if deep.size:
            raise RuntimeError(
                f"contact pair {self.name}: node {self.nodes[deep[0]]} went through the target "
                f"(gap {contact_state.gap[deep[0]]:.3e} m, reach {self.reach:.3e} m)"
            )
        contact_state.release(gone)
        self._choose(item)
        self._searched = True
        self._watch_left, self._way = _WATCH, 0.0
        self.exchange.mark()

    def _safe_steps(self, dt: float) -> int:
        """Return how many steps no node outside the margin can arrive in."""
        v, nc = self.exchange.xv[:, 3:], self.search.nc
        speed = np.linalg.norm(v - v[nc:].mean(axis=0), axis=1)
        fastest = float(speed[:nc].max() + speed[nc:].max())
        steps = self.margin / max(_SPEED_RESERVE * fastest * dt, 1e-300)
        return max(1, int(min(steps, _LONGEST_INTERVAL)))

    def _choose(self, item: Index) -> None:
        self.item = np.ascontiguousarray(item)
        self.c_item = view("item", self.item, (-1,), np.int32)
        self.exchange.choose(self.search.neighbourhood(self.item))

    def saved(self) -> dict[str, npt.NDArray[Any]]:
        """Return what the coming steps depend on, as arrays by name."""
        return {
            "item": self.item.copy(),
            "live": self.search.live.copy(),
            "outward": self.search.outward.copy(),
            "past": self.exchange.past.copy(),
            "schedule": np.array([self._steps_left, self._searched, self._watch_left, self._way]),
        }

    def load(self, memory: dict[str, npt.NDArray[Any]]) -> None:
        """Take over what :meth:`saved` returned."""
        self.search.live[:] = memory["live"]
        self.search.outward[:] = memory["outward"]
        self.exchange.past[:] = memory["past"]
        self._choose(np.asarray(memory["item"], dtype=np.int32))
        steps, searched, watch, self._way = memory["schedule"]
        self._steps_left, self._searched, self._watch_left = int(steps), bool(searched), int(watch)
