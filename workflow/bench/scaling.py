# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Step time of a scene on more ranks than there are: partitions counted, rates measured here.

The time of a step on ``P`` ranks is that of the part that needs the longest,

    max (Σ cells · kernel + nodes · update + messages · latency + bytes / bandwidth)
      + contact + fixed + gathers + reductions.

Of the contact, ranks share search and tracking of the candidates evenly, and tell each other of
them; they read the nodes they own, counted as even too; its forces are computed on every rank. What
``fixed`` stands for, the calls of a step, is on every rank as well. A message is one of three
rounds with the neighbours: forces to the owners of ghosts, then displacements and velocities back,
24 bytes for a node each. A gather brings all ranks the nodes near the patch, 48 bytes each, their
closest points, 56, and at a search the nodes of both surfaces. An all-reduce of an array takes
``latency · log₂ P``, one of a Python object four times that: count and data, up the tree and down.
Left out are the nodes of springs, drive and carried mass (under a tenth of a step, which ranks
share), packing, waiting for ranks that are disturbed, and congestion of the network.
"""

import csv
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from contact._kernel import lib
from contact.sharing import LEAST
from meshes.arrays import Array
from meshes.hexmesh import HexMesh
from workflow.bench.contact_share import ContactShare, contact_share
from workflow.bench.machine_rates import Rates, rates
from workflow.bench.partition import Parts, dual_graph, partition, parts_of
from workflow.model.geometry import mesh_of
from workflow.model.zones import zone
from workflow.results.table import Column, Table
from workflow.scene import Scene

NODE_BYTES = 24  # three doubles
CONTACT_BYTES = 48  # position and velocity
POINT_BYTES = 8 * lib.WR_ROW  # a closest point
OBJECT_TREES = 4  # a Python object goes as count and data, up a tree and down
WATCH = 16  # steps between two measurements of how far surfaces have moved
PAYS = 1.3  # gain of a doubling that is still worth its ranks
TERMS = ("kernel", "update", "fixed", "contact", "gathers", "messages", "bytes", "reductions")


@dataclass(frozen=True)
class Network:
    """What ranks talk over.

    Attributes:
        latency: Time of a message without content [s].
        bandwidth: Of one rank in each direction [byte/s].
    """

    latency: float = 1.5e-6
    bandwidth: float = 10e9


@dataclass(frozen=True)
class Load:
    """What a step of a scene asks for, apart from how its mesh is cut.

    Attributes:
        of_cell: Time of each cell, shape ``(c,)`` [s].
        rates: Those of nodes and calls.
        contact: Contact of the scene.
        trees: Passes of small all-reduces through a tree in a step.
    """

    of_cell: Array
    rates: Rates
    contact: ContactShare
    trees: float


def measure(
    scene: Scene,
    counts: Sequence[int],
    network: Network,
    larger: int | None = None,
    log: Callable[[str], Any] = lambda line: None,
) -> dict[str, Any]:
    """Return sizes, rates and, for each number of ranks, partition and step of a scene.

    Args:
        scene: The scene.
        counts: Numbers of ranks; one is always among them.
        network: What they talk over.
        larger: Cells of a finer mesh to extrapolate to.
        log: Takes a line of progress.
    """
    mesh, placement = mesh_of(scene, log)
    log("rates of one core")
    load = load_of(scene, mesh, rates(scene), contact_share(scene, mesh, placement))
    neighbours, rows = dual_graph(mesh), []
    for count in sorted({1, *counts}):
        log(f"{count} parts of {len(mesh.cells)} cells")
        parts = parts_of(mesh.cells, partition(neighbours, count), len(mesh.points), count)
        rows.append(row_of(parts, load, network))
    found = sizes_of(scene, mesh, load) | {"network": asdict(network)} | judged(rows)
    if larger is not None:
        factor = larger / len(mesh.cells)
        found["extrapolated"] = {"cells": larger, **judged([refined(r, factor) for r in rows])}
    return found


def sizes_of(scene: Scene, mesh: HexMesh, load: Load) -> dict[str, Any]:
    """Return what the prediction of a scene starts from."""
    return {
        "scene": scene.name,
        "cells": len(mesh.cells),
        "nodes": len(mesh.points),
        "contact_nodes": len(load.contact.nodes),
        "contact_surface": load.contact.surface,
        "searches_per_step": load.contact.searches,
        "contact_seconds": load.contact.seconds,
        "shared_seconds": load.contact.shared,
        "search_seconds": load.contact.searching,
        "trees_per_step": load.trees,
        "rates": asdict(load.rates),
    }


def load_of(scene: Scene, mesh: HexMesh, rates: Rates, contact: ContactShare) -> Load:
    """Return what a step of the scene asks for."""
    of_cell = np.zeros(len(mesh.cells))
    for name, body in scene.bodies.items():
        of_cell[np.isin(mesh.regions, mesh.tags(body.regions))] = rates.cell[name][body.element]
        if body.contact_zone:
            near = zone(scene, mesh, name, "contact_zone")
            of_cell[near] = rates.cell[name][body.near_element]
    return Load(of_cell, rates, contact, trees(scene))


def trees(scene: Scene) -> float:
    """Return how often a step goes through a tree of all ranks for a few numbers.

    The guard of finite values, point masses and the drive send an array each; the watch of each
    pass three Python objects, now and then.
    """
    passes = sum(2 if contact.two_pass else 1 for contact in scene.contacts.values())
    linked = bool(scene.springs or scene.absorbing or scene.vehicle or scene.track)
    driven = scene.rolling is not None and scene.rolling.traction_coefficient > 0
    return 1 + OBJECT_TREES * 3 * passes / WATCH + linked + driven


def row_of(parts: Parts, load: Load, network: Network) -> dict[str, Any]:
    """Return partition and predicted step on as many ranks as there are parts.

    ``work_imbalance`` is the most time for cells and nodes over its mean, ``contact_ranks`` how
    many own nodes near the patch.
    """
    messages, sizes = exchanged(parts)
    compute = {
        "kernel": np.bincount(parts.of_cell, load.of_cell, parts.count),
        "update": parts.owned * load.rates.node,
    }
    talk = {"messages": messages * network.latency, "bytes": sizes / network.bandwidth}
    work = compute["kernel"] + compute["update"]
    slowest = int(np.argmax(work + talk["messages"] + talk["bytes"]))
    terms = {name: float(of_part[slowest]) for name, of_part in (compute | talk).items()}
    terms |= alike(load, parts.count, network)
    held = np.bincount(parts.owner[load.contact.nodes], minlength=parts.count)
    return {
        "ranks": parts.count,
        "cells_per_rank": float(parts.cells.mean()),
        "imbalance": parts.imbalance,
        "work_imbalance": float(work.max() / work.mean()),
        "owned_max": int(parts.owned.max()),
        "ghosts": int(parts.ghosts.sum()),
        "ghosts_max": int(parts.ghosts.max()),
        "neighbours": float(parts.neighbours.mean()),
        "neighbours_max": int(parts.neighbours.max()),
        "messages_max": int(messages.max()),
        "bytes_max": int(sizes.max()),
        "contact_ranks": int((held > 0).sum()),
        "terms": {name: terms[name] for name in TERMS},
        "step": sum(terms.values()),
    }


def exchanged(parts: Parts) -> tuple[Array, Array]:
    """Return messages and bytes of a step for each part, those of the busier direction, ``(P,)``.

    Forces go from ghosts to their owners, displacements and velocities the other way.
    """
    messages = np.maximum(parts.owners + 2 * parts.holders, 2 * parts.owners + parts.holders)
    nodes = np.maximum(parts.ghosts + 2 * parts.told, 2 * parts.ghosts + parts.told)
    return messages.astype(np.float64), NODE_BYTES * nodes.astype(np.float64)


def alike(load: Load, count: int, network: Network) -> dict[str, float]:
    """Return the terms that are the same on all of ``count`` ranks [s]."""
    contact, levels = load.contact, float(np.ceil(np.log2(count)))
    away = CONTACT_BYTES * (count - 1) / count / network.bandwidth
    takers = max(1, min(count, contact.tracked // LEAST))
    near = contact.gathers * (levels * network.latency + len(contact.nodes) * away)
    if takers > 1:
        points = POINT_BYTES / CONTACT_BYTES * contact.tracked
        near += (1 + contact.searches) * (levels * network.latency + points * away)
    all_nodes = contact.searches * (levels * network.latency + contact.surface * away)
    return {
        "contact": contact.seconds - contact.shared * (1 - 1 / takers),
        "fixed": load.rates.fixed,
        "gathers": near + all_nodes,
        "reductions": load.trees * levels * network.latency,
    }


def refined(row: dict[str, Any], factor: float) -> dict[str, Any]:
    """Return the row of a mesh of more cells on as many ranks, by surface to volume.

    Cells and nodes grow by ``factor``, ghosts and contact by its power 2/3; shape and number of the
    parts stay.
    """
    border = factor ** (2 / 3)
    powers = dict.fromkeys(("kernel", "update"), factor)
    powers |= dict.fromkeys(("contact", "gathers", "bytes"), border)
    terms = {name: value * powers.get(name, 1.0) for name, value in row["terms"].items()}
    sizes = {
        "cells_per_rank": row["cells_per_rank"] * factor,
        "owned_max": row["owned_max"] * factor,
    }
    sizes |= {name: row[name] * border for name in ("ghosts", "ghosts_max", "bytes_max")}
    return row | sizes | {"terms": terms, "step": sum(terms.values())}


def judged(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return rows, from one rank up, with what they gain, and where ranks stop paying.

    ``pays_until`` is the last number of ranks before a doubling gains less than ``PAYS``, and
    ``pays_until_without_contact`` what it would be if contact cost nothing; ``contact_tenth`` and
    ``contact_half`` are the numbers at which contact takes that part of the step.
    """
    found = compared(rows)
    return {
        "ranks": found,
        "pays_until": paying(found),
        "pays_until_without_contact": paying(compared([without_contact(row) for row in rows])),
        "contact_tenth": reached(found, 0.1),
        "contact_half": reached(found, 0.5),
    }


def compared(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return rows with speed-up, efficiency, gain of a doubling, share of contact, largest term."""
    found: list[dict[str, Any]] = []
    for before, row in zip([None, *rows], rows, strict=False):
        gain = None
        if before is not None:
            doublings = np.log2(row["ranks"] / before["ranks"])
            gain = float((before["step"] / row["step"]) ** (1 / doublings))
        speedup, terms = rows[0]["step"] / row["step"], row["terms"]
        gained = {
            "speedup": speedup,
            "efficiency": speedup / row["ranks"],
            "gain_of_doubling": gain,
            "contact_share": (terms["contact"] + terms["gathers"]) / row["step"],
            "largest": max(terms, key=terms.__getitem__),
        }
        found.append(row | gained)
    return found


def without_contact(row: dict[str, Any]) -> dict[str, Any]:
    """Return the row of a step in which contact costs nothing, the most that sharing can give."""
    terms = row["terms"] | {"contact": 0.0, "gathers": 0.0}
    return row | {"terms": terms, "step": sum(terms.values())}


def paying(rows: list[dict[str, Any]]) -> int | None:
    """Return the last number of ranks before a doubling gains too little, None if none does."""
    for before, row in pairwise(rows):
        if row["gain_of_doubling"] < PAYS:
            return int(before["ranks"])
    return None


def reached(rows: list[dict[str, Any]], share: float) -> float | None:
    """Return the number of ranks at which contact takes a share of the step, None if it never does.

    Between two rows the share is taken as linear in the logarithm of the ranks.
    """
    shares = [row["contact_share"] for row in rows]
    for k, value in enumerate(shares):
        if value >= share:
            if k == 0:
                return float(rows[0]["ranks"])
            part = (share - shares[k - 1]) / (value - shares[k - 1])
            low, high = np.log([rows[k - 1]["ranks"], rows[k]["ranks"]])
            return float(np.exp(low + part * (high - low)))
    return None


def write(found: dict[str, Any], path: Path) -> Path:
    """Write partition and step of each number of ranks as CSV, times in seconds."""
    rows = [{"cells": found["cells"], "extrapolated": 0} | row for row in found["ranks"]]
    if "extrapolated" in found:
        more = found["extrapolated"]
        rows += [{"cells": more["cells"], "extrapolated": 1} | row for row in more["ranks"]]
    flat = [{**row, **row["terms"]} for row in rows]
    keys = [key for key in flat[0] if key != "terms"]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, keys, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(flat)
    return path


def printout(found: dict[str, Any]) -> Iterator[str | Table]:
    """Yield the tables of a scaling, and what they come to."""
    network = found["network"]
    searching = found["search_seconds"] / max(found["contact_seconds"], 1e-12)
    rates = found["rates"]["cell"].items()
    cells = ", ".join(f"{k} {1e-6 / s:.1f} ({e})" for k, own in rates for e, s in own.items())
    yield (
        f"{found['scene']}: {found['cells']} cells, {found['nodes']} nodes; ranks share "
        f"{found['contact_nodes']} contact nodes at a step, {found['contact_surface']} at a search "
        f"({found['searches_per_step']:.4f} a step, {searching:.0%} of the contact's time); "
        f"{network['latency'] * 1e6:.1f} µs, "
        f"{network['bandwidth'] / 1e9:.0f} GB/s; one core of this machine makes "
        f"{cells} M/s, and {found['rates']['node'] * 1e9:.1f} ns a node"
    )
    yield Table("partition, most of a rank", PARTITION, found["ranks"])
    yield Table("predicted step [µs]", STEP, found["ranks"])
    yield in_words(found)
    if "extrapolated" in found:
        more = found["extrapolated"]
        title = f"{more['cells']} cells, extrapolated by surface to volume [µs]"
        yield Table(title, STEP, more["ranks"])
        yield in_words(more)


def in_words(found: dict[str, Any]) -> str:
    """Return where ranks stop paying and where contact hurts, in words."""
    until, last = found["pays_until"], found["ranks"][-1]["ranks"]
    parts = [f"a doubling gains {PAYS} and more up to {last} ranks, the most that were asked for"]
    if until is not None:
        poor = next(row for row in found["ranks"] if row["ranks"] > until)
        parts = [
            f"beyond {until} ranks a doubling gains less than {PAYS}: at {poor['ranks']} the "
            f"largest term is {poor['largest']}"
        ]
    free = found["pays_until_without_contact"]
    parts.append(f"without contact {'at no number here' if free is None else f'beyond {free}'}")
    for key, share in (("contact_tenth", "10 %"), ("contact_half", "50 %")):
        at = found[key]
        where = "at none of these" if at is None else f"at {at:.0f} ranks"
        parts.append(f"contact takes {share} of the step {where}")
    return "; ".join(parts)


def _term(name: str) -> Callable[[Any], float]:
    return lambda row: float(row["terms"][name])


def _digits(value: float) -> str:
    return f"{value:.0f}" if value >= 9.95 or value == 0 else f"{value:.1f}"


PARTITION = (
    Column("ranks", "ranks"),
    Column("cells", "cells_per_rank", ".0f"),
    Column("max/mean", "imbalance", ".3f"),
    Column("work", "work_imbalance", ".3f"),
    Column("nodes", "owned_max", ".0f"),
    Column("ghosts", "ghosts_max", ".0f"),
    Column("neighbours", "neighbours_max"),
    Column("messages", "messages_max"),
    Column("kB", "bytes_max", ".1f", factor=1e-3),
    Column("contact on", "contact_ranks"),
)
HEADS = ("kernel", "update", "calls", "contact", "gather", "send", "bytes", "sums")  # of TERMS
STEP = (
    Column("ranks", "ranks"),
    *(
        Column(head, _term(name), _digits, factor=1e6)
        for head, name in zip(HEADS, TERMS, strict=True)
    ),
    Column("step", "step", _digits, factor=1e6),
    Column("gain", "speedup", ".1f"),
    Column("eff.", "efficiency", ".0%"),
    Column("×2", "gain_of_doubling", ".2f"),
)
