# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact patches: nodes parted by peaks of pressure, patches followed from output to output."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array

from meshes.arrays import Array, Index

if TYPE_CHECKING:
    from contact.footprint import Footprint


BRIDGE = 1 / 3  # of the lower of two peaks of pressure: weaker nodes do not join them
FAINT = 1 / 20  # of the higher peak: a lower one that touches it is no patch of its own
REACH = 0.75  # of the radii of two nodes' areas together: nearer ones lie on each other
FEW = 2**16  # pairs of nodes, up to which a tree of them costs more than all their distances
LINK = 1 / 3  # of its area: what a patch has in common with one that it goes on from


def beside(facets: npt.NDArray[np.int32], touching: Index, n: int) -> list[Index]:
    """Return the neighbours of each touching node by their place; nodes of one facet are such.

    Args:
        facets: Contactor facets, shape ``(q, 4)``.
        touching: Surface nodes in contact, ascending, shape ``(k,)``.
        n: Number of surface nodes.
    """
    place = np.full(n, -1, dtype=np.int64)
    place[touching] = np.arange(len(touching))
    corner = place[facets]
    corner = corner[(corner >= 0).sum(axis=1) > 1]
    i, j = np.repeat(corner, 4, axis=1).ravel(), np.tile(corner, (1, 4)).ravel()
    both = (i >= 0) & (j >= 0) & (i != j)
    shape = (len(touching), len(touching))
    graph = coo_array((np.ones(both.sum()), (i[both], j[both])), shape=shape).tocsr()
    return np.split(graph.indices.astype(np.int64), graph.indptr[1:-1]) if len(touching) else []


def parted(pressure: Array, neighbours: Sequence[Any]) -> Index:
    """Return the patch of each node: one for each peak of pressure that stands out.

    Two peaks that touch belong to one patch if the pressure between them stays above ``BRIDGE``
    times the lower peak, or if that is below ``FAINT`` times the higher one. So a few weak nodes
    between rail top and gauge corner, which lie in each other (conformal contact), do not make
    them one. Patches are numbered from 0.

    Args:
        pressure: Of each node, shape ``(n,)`` [Pa].
        neighbours: Of each node, see :func:`beside`.
    """
    peak = np.full(len(pressure), -1, dtype=np.int64)  # a patch is named after its peak
    for node in np.argsort(-pressure, kind="stable"):
        around = sorted({int(peak[k]) for k in neighbours[node]} - {-1}, key=lambda k: -pressure[k])
        peak[node] = around[0] if around else node
        for lower in around[1:]:
            weak = pressure[lower] < FAINT * pressure[around[0]]
            if weak or pressure[node] > BRIDGE * pressure[lower]:
                peak[peak == lower] = around[0]
    return np.asarray(np.unique(peak, return_inverse=True)[1], dtype=np.int64).reshape(-1)


@dataclass(frozen=True)
class Event:
    """What happened to a patch between two outputs.

    Attributes:
        t: Time of the later output [s].
        kind: ``birth``, ``end``, ``split`` (``patch`` broke off ``other``) or ``merge`` (``patch``
            was taken up by ``other``).
        patch: Identity of the patch.
        other: The other patch of a split or merge, else -1.
    """

    t: float
    kind: str
    patch: int
    other: int = -1


@dataclass(frozen=True)
class _Seen:
    """The last output: time, position and radius of each node, patch and identity."""

    t: float
    position: Array
    radius: Array
    patch: Index
    identity: Index

    def centres(self) -> Array:
        k = range(len(self.identity))
        return np.array([self.position[self.patch == i].mean(axis=0) for i in k]).reshape(-1, 3)


class Tracker:
    """Gives patches an identity that lasts: a number, counted from 0 in the order of birth.

    Patches of two outputs are the same if they cover each other, once the way that all contact
    has travelled in between is taken off. That way is the one, of those that bring some old patch
    onto some new one, that covers most; among ways about as good, the one nearest to the last
    velocity of travel. Of parts that came from one patch, the one with most in common keeps its
    identity, the others are new (split); of patches that became one, likewise (merge).
    """

    def __init__(self) -> None:
        self._last: _Seen | None = None
        self._travel = np.zeros(3)  # velocity of the patches [m/s]
        self._count = 0

    def follow(self, t: float, footprint: "Footprint") -> tuple[Index, list[Event]]:
        """Return the identity of each patch of a footprint, and what happened since the last one.

        Args:
            t: Time, later than that of the last call [s].
            footprint: Nodes in contact and their patches.
        """
        none = np.full(len(footprint.patches), -1)
        radius = np.sqrt(footprint.area / np.pi)
        now = _Seen(t, footprint.position, radius, footprint.patch, none)
        last = self._last or _Seen(t, np.zeros((0, 3)), np.zeros(0), none[:0], none[:0])
        common, share = self._overlap(last, now)
        events = self._link(last, now, common, share >= LINK)
        self._last = now
        return now.identity, events

    def memory(self) -> dict[str, npt.NDArray[Any]]:
        """Return all that the next call depends on, for a checkpoint."""
        own = np.array([self._count, np.nan if self._last is None else self._last.t])
        last = {} if self._last is None else vars(self._last)
        return {"own": own, "travel": self._travel} | {k: a for k, a in last.items() if k != "t"}

    def restore(self, memory: dict[str, npt.NDArray[Any]]) -> None:
        """Go on from what :meth:`memory` returned."""
        count, t = memory["own"]
        self._count, self._travel = int(count), memory["travel"]
        names = ("position", "radius", "patch", "identity")
        self._last = None if np.isnan(t) else _Seen(float(t), *(memory[k] for k in names))

    def _new(self, now: _Seen, j: int) -> int:
        now.identity[j] = self._count
        self._count += 1
        return self._count - 1

    def _overlap(self, last: _Seen, now: _Seen) -> tuple[Array, Array]:
        """Return area [m2] and share of patches in common, ``(old, new)``; note the travel."""
        old, new = len(last.identity), len(now.identity)
        if not (old and new):
            return np.zeros((old, new)), np.zeros((old, new))
        guess = self._travel * (now.t - last.t)
        between = (now.centres()[None, :] - last.centres()[:, None]).reshape(-1, 3)
        ways = np.vstack([guess, np.zeros(3), between])
        found = [_common(last, now, way) for way in ways]
        covered = np.array([area.sum() for area, _ in found])
        good = np.flatnonzero(covered >= 0.9 * covered.max())
        best = good[np.argmin(np.linalg.norm(ways[good] - guess, axis=1))]
        area, share = found[best]
        if area.any():  # follow the largest patch itself, not the guess
            self._travel = between[np.argmax(area)] / (now.t - last.t)
        return area, share

    def _link(
        self, last: _Seen, now: _Seen, common: Array, linked: npt.NDArray[np.bool_]
    ) -> list[Event]:
        """Hand identities on, those of the largest common areas first; return what happened."""
        events, taken = [], np.zeros(len(last.identity), dtype=bool)
        order = np.argsort(-common, axis=None, kind="stable")
        for i, j in zip(*np.unravel_index(order, common.shape), strict=True):
            if linked[i, j] and not taken[i] and now.identity[j] < 0:
                now.identity[j], taken[i] = last.identity[i], True
        for j in np.flatnonzero(now.identity < 0):
            i = _largest(common[:, j], linked[:, j])
            other = int(last.identity[i]) if i >= 0 else -1
            kind = "split" if i >= 0 else "birth"
            events.append(Event(now.t, kind, self._new(now, int(j)), other))
        for i in np.flatnonzero(~taken):
            j = _largest(common[i], linked[i])
            other = int(now.identity[j]) if j >= 0 else -1
            kind = "merge" if j >= 0 else "end"
            events.append(Event(now.t, kind, int(last.identity[i]), other))
        return events


def _largest(common: Array, linked: npt.NDArray[np.bool_]) -> int:
    return int(np.argmax(np.where(linked, common, -1.0))) if linked.any() else -1


def nearest(points: Array, places: Array) -> tuple[Array, Index]:
    """Return the distance of each place from the nearest of some points, and which that is."""
    if len(points) and len(points) * len(places) <= FEW:
        away = places[:, None] - points
        square = np.einsum("ijk,ijk->ij", away, away)
        k = np.argmin(square, axis=1)
        return np.sqrt(square[np.arange(len(k)), k]), k
    from scipy.spatial import cKDTree  # a fifteenth of a second to import

    distance, k = cKDTree(points).query(places)
    return distance, k


def _common(last: _Seen, now: _Seen, way: Array) -> tuple[Array, Array]:
    """Return the area that patches have in common [m2] and its share of the one it fills more.

    A node lies on the patch of the nearest node of the other output, if that is near enough.
    """
    moved, shape = last.position + way, (len(last.identity), len(now.identity))
    total, share = np.zeros(shape), np.zeros(shape)
    for one, other, here, there in (
        (now, last, now.position, moved),
        (last, now, moved, now.position),
    ):
        distance, k = nearest(there, here)
        on = distance <= REACH * (one.radius + other.radius[k])
        area = np.zeros((len(other.identity), len(one.identity)))
        np.add.at(area, (other.patch[k[on]], one.patch[on]), np.pi * one.radius[on] ** 2)
        part = area / np.bincount(one.patch, np.pi * one.radius**2, len(one.identity))
        total += (area if one is now else area.T) / 2
        share = np.maximum(share, part if one is now else part.T)
    return total, share
