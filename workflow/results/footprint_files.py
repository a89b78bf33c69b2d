# SPDX-License-Identifier: LGPL-3.0-or-later
"""Footprints as files for others: surfaces over time for ParaView and pyvista, and CSV.

``footprints.pvd`` lists a file ``PAIR-SIDE-K.vtp`` for both bodies of each pair and every output K:
the facets round the nodes in contact where they are at that time, with what the nodes bear.
"""

import csv
import re
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from workflow.results import atomic
from workflow.results.footprints import Facets, read
from workflow.scene import SceneError

SERIES = "footprints.pvd"
AXES = "xyz"
NO_NAME = r"[^\w.-]"  # what a pair may be called but a file should not be


def export(folder: Path, out: Path, *, tables: bool = False) -> dict[str, Any]:
    """Write the footprints of a run as surfaces, and as CSV if told; older files are replaced.

    Args:
        folder: Result folder.
        out: Where the files go; made if missing.
        tables: One CSV for each output too, a row for each node that bears forces.

    Returns:
        ``series``: the file that lists the surfaces; ``outputs``: how many; ``tables``: the CSVs.

    Raises:
        SceneError: if the run has no footprints, pyvista is missing, or files cannot be written.
    """
    if find_spec("pyvista") is None:
        raise SceneError(
            "export-footprints: expected pyvista, which comes with squealx[figures]; found none"
        )
    entries, written, outputs = [], [], 0
    for k, found in enumerate(read(folder)):
        try:
            out.mkdir(parents=True, exist_ok=True)
            entries += [write_surface(facets, part, k, out) for part, facets in enumerate(found)]
            if tables:
                written.append(str(write_table(found, out / f"footprints-{k:05d}.csv")))
        except OSError as error:
            raise cannot_write(out, error) from error
        outputs += 1
    try:
        atomic.replace(out / SERIES, series(entries).encode())
    except OSError as error:
        raise cannot_write(out, error) from error
    return {"series": str(out / SERIES), "outputs": outputs, "tables": written}


def cannot_write(out: Path, error: OSError) -> SceneError:
    """Return the error of a folder that takes no files."""
    why = error.strerror or str(error)
    return SceneError(f"out = {str(out)!r}: expected a folder with room that can be written: {why}")


def write_surface(facets: Facets, part: int, k: int, out: Path) -> tuple[float, int, str, str]:
    """Write the contact on one body at output ``k``; return its entry in the series.

    Raises:
        OSError: if it cannot be written.
    """
    name = f"{facets.pair}-{facets.side}"
    path = out / f"{re.sub(NO_NAME, '_', name)}-{k:05d}.vtp"
    path.unlink(missing_ok=True)
    surface(facets).save(path)
    if not path.exists():  # VTK takes a broken file away, and says so on stderr alone
        raise OSError(f"VTK could not write {path.name}")
    return facets.t, part, name, path.name


def surface(facets: Facets) -> Any:
    """Return the contact on one body as pyvista surface; all arrays are there, even of no node."""
    import pyvista
    from vtkmodules.util.numpy_support import numpy_to_vtk

    corners = np.column_stack([np.full(len(facets.facets), 4), facets.facets])
    made: Any = pyvista.PolyData(facets.position, faces=corners.ravel())
    for name, values in ({"node": facets.node} | facets.nodal).items():
        array = numpy_to_vtk(np.ascontiguousarray(values), deep=True)  # pyvista refuses empty ones
        array.SetName(name)
        made.GetPointData().AddArray(array)
    made.field_data["pair"], made.field_data["side"] = [facets.pair], [facets.side]
    return made


def series(entries: list[tuple[float, int, str, str]]) -> str:
    """Return the text of a ParaView collection from time, part, name and file of each surface."""
    lines = (
        f'<DataSet timestep="{t!r}" part="{part}" name={quoteattr(name)} file={quoteattr(file)}/>'
        for t, part, name, file in entries
    )
    head = '<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">'
    return "\n".join(
        ['<?xml version="1.0"?>', head, "<Collection>", *lines, "</Collection>", "</VTKFile>", ""]
    )


def write_table(found: list[Facets], path: Path) -> Path:
    """Write the nodes that bear forces at one output, SI units, all bodies in one table."""
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        for i, facets in enumerate(found):
            columns = dict(_columns(facets))
            if i == 0:
                table.writerow(["t", "pair", "side", *columns])
            for row in zip(*columns.values(), strict=True):
                table.writerow([facets.t, facets.pair, facets.side, *row])
    return path


def _columns(facets: Facets) -> Iterator[tuple[str, list[Any]]]:
    """Yield the columns of a table, a vector as three."""
    bears = facets.nodal["pressure"] > 0
    arrays = {"node": facets.node, "position": facets.position} | facets.nodal
    for name, array in arrays.items():
        values = np.asarray(array)[bears]
        if values.ndim == 1:
            yield name, values.tolist()
        else:
            yield from ((f"{name}_{AXES[a]}", values[:, a].tolist()) for a in range(3))
