# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points of a run on the shakedown map: largest pressure over k, and traction over normal force.

k is the yield stress in shear of the weaker of the bodies that yield, its first yield stress over
√3. Each patch of a run has a point at every output, and so does each load that travels.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from meshes.arrays import Array
from workflow.results.batch import opened
from workflow.scene import Scene


@dataclass(frozen=True)
class Trail:
    """The points of one patch, or of a load that travels, over the outputs.

    Attributes:
        of: What it is of, in words.
        t: Times, shape ``(n,)`` [s].
        pressure: Largest pressure over k, shape ``(n,)``.
        traction: Tangential over normal force, shape ``(n,)``.
        t_gamma: Tangential force times creepage, shape ``(n,)``; not a number for loads [N].
    """

    of: str
    t: Array
    pressure: Array
    traction: Array
    t_gamma: Array

    @property
    def heaviest(self) -> dict[str, Any]:
        """The point with the largest pressure, as a row of a table."""
        k = int(np.argmax(self.pressure))
        wear = float(self.t_gamma[k])
        return {
            "pressure_over_k": float(self.pressure[k]),
            "traction_coefficient": float(self.traction[k]),
            "t_gamma": wear if np.isfinite(wear) else None,
        }


NOTHING: dict[str, Any] = dict.fromkeys(("pressure_over_k", "traction_coefficient", "t_gamma"))


def yield_in_shear(scene: Scene) -> float | None:
    """Return the yield stress in shear of the weaker of the bodies that yield, or None [Pa]."""
    materials = [body.material for body in scene.bodies.values()]
    stresses = [m.yield_stress for m in materials if hasattr(m, "yield_stress")]
    return float(min(stresses)) / 3**0.5 if stresses else None


def trails(folder: Path, scene: Scene) -> list[Trail]:
    """Return the points of a run; none if no body yields, or nothing presses on it."""
    k = yield_in_shear(scene)
    return [] if k is None else [*_loads(scene, k), *_patches(folder)]


def heaviest(folder: Path, scene: Scene) -> dict[str, Any]:
    """Return the point with the largest pressure of all patches and loads, as a row of a table."""
    found = [trail.heaviest for trail in trails(folder, scene)]
    return max(found, key=lambda row: float(row["pressure_over_k"]), default=NOTHING)


def _loads(scene: Scene, k: float) -> Iterator[Trail]:
    """Yield the point of each load that travels: on a surface that looks up or down."""
    for load in scene.loads:
        if load.travelling is not None and load.traction is not None:
            x, y, z = load.traction
            where, nothing = np.array([load.travelling.until / 2]), np.array([np.nan])
            share = np.hypot(x, y) / abs(z) if z else np.inf
            of = f"load on {load.surface}"
            yield Trail(of, where, np.array([abs(z) / k]), np.array([share]), nothing)


def _patches(folder: Path) -> Iterator[Trail]:
    """Yield the points of each patch of each pair."""
    with opened(folder / "results.h5") as file:
        for pair, table in file.get("patches", {}).items():
            if "pressure_over_k" not in table:  # nothing touched
                continue
            names = ("patch", "t", "pressure_over_k", "traction_coefficient", "t_gamma")
            patch, *columns = (table[name][:] for name in names)
            for k in np.unique(patch):
                own = [column[patch == k] for column in columns]
                yield Trail(f"{pair}, patch {k}", *own)
