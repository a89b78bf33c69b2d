# SPDX-License-Identifier: LGPL-3.0-or-later
"""Acceleration of repeated steps to a fixed point (Anderson 1965)."""

from mpi4py import MPI

import numpy as np

from meshes.arrays import Array

DEPTH = 4  # differences between steps that are kept


class Secants:
    """What past steps tell about the next one, while the map that makes them stays the same.

    A step that is off by a few slow motions, such as those of a soft spring or of a wheel that
    slides across a curved rail, is put right in all of them at once.
    """

    def __init__(self, comm: MPI.Comm) -> None:
        self.comm = comm
        self.forget()

    def forget(self) -> None:
        """Start anew: another map makes the steps."""
        self._last: tuple[Array, Array] | None = None
        self._past: list[tuple[Array, Array]] = []

    def improved(self, u: Array, step: Array) -> Array:
        """Return a better step from ``u``, of the size and shape of the owned dofs [m].

        Args:
            u: Where the step is made from.
            step: As the map makes it.
        """
        if self._last is not None:
            self._past = [*self._past, (u - self._last[0], step - self._last[1])][-DEPTH:]
        self._last = u.copy(), step.copy()
        if not self._past:
            return step
        changes = np.array([change for _, change in self._past])
        scale = 1.0 / np.sqrt(self.comm.allreduce((changes**2).sum(axis=1)) + 1e-300)
        changes *= scale[:, None]
        normal = self.comm.allreduce(changes @ changes.T), self.comm.allreduce(changes @ step)
        share = scale * np.linalg.lstsq(*normal, rcond=1e-8)[0]
        for part, (way, change) in zip(share, self._past, strict=True):
            step = step - part * (way + change)
        return step
