# SPDX-License-Identifier: LGPL-3.0-or-later
"""Models of gmsh, scripts or functions, meshed in this process; their physical groups as names."""

import re
import tempfile
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as package_version
from pathlib import Path
from typing import Any

from meshes.formats import read_write
from meshes.hexmesh import HexMesh

HEXAHEDRON = 5  # gmsh's number of the cell with eight nodes
WARNINGS = 5  # of gmsh, passed on at most
Values = Mapping[str, Any]  # numbers, texts or lists of numbers
HINT = (
    "transfinite curves, surfaces and volumes with Recombine Surface, or Extrude with Layers and "
    "Recombine, make hexahedra"
)


def loaded() -> Any:
    """Return gmsh's module.

    Raises:
        ValueError: if it is not installed or cannot be loaded.
    """
    try:
        import gmsh
    except (ImportError, OSError) as error:  # OSError: a library of the system is missing
        raise ValueError(
            f"gmsh cannot be loaded ({error}); expected pip install 'squealx[mesh]', on Debian "
            "with apt install libglu1-mesa libxrender1 libxcursor1 libxft2 libxinerama1"
        ) from None
    return gmsh


def version() -> str:
    """Return gmsh's version, without loading it if it is a Python package."""
    with suppress(PackageNotFoundError):
        return package_version("gmsh")
    return str(loaded().GMSH_API_VERSION)


def meshed(
    model: Path | Callable[..., Any],
    parameters: Values,
    *,
    names: Iterable[str],
    log: Callable[[str], Any] = lambda line: None,
) -> HexMesh:
    """Return the hexahedra of a model of gmsh, with its physical groups as regions and surfaces.

    A script finds the parameters as variables, a function gets them by name and builds its model
    with the module ``gmsh``, which is initialized for it. What it has not meshed is meshed then.

    Args:
        model: A script, ``.geo``, or a function.
        parameters: What it is given.
        names: The physical groups to use.
        log: Called with gmsh's warnings.

    Raises:
        ValueError: if gmsh refuses the model, or it does not make hexahedra in named groups.
    """
    gmsh = loaded()
    if gmsh.isInitialized():
        raise ValueError("gmsh is in use in this process; expected gmsh.finalize() before")
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.logger.start()
        if isinstance(model, Path):
            _read_script(gmsh, model, parameters)
        else:
            _call(gmsh, model, parameters)
        if not len(gmsh.model.mesh.getElementTypes(3)):
            gmsh.model.mesh.generate(3)
        _check_cells(gmsh)
        said = [x for x in gmsh.logger.get() if x.startswith(("Warning", "Error"))]
        for line in said[:WARNINGS]:
            log(f"gmsh: {line}")
        return _through_a_file(gmsh, names)
    except (ValueError, OSError):
        raise
    except Exception as error:  # gmsh raises nothing more special
        raise ValueError(f"gmsh: {error}") from None
    finally:
        if gmsh.isInitialized():
            gmsh.logger.stop()  # else the next model is warned of it
            gmsh.finalize()


def script_files(script: Path) -> dict[Path, str]:
    """Return the text of a script and of those that it includes or merges, by path."""
    found: dict[Path, str] = {}
    waiting = [script]
    while waiting:
        path = waiting.pop()
        if path in found or not path.is_file():
            continue
        found[path] = path.read_text("utf-8", errors="replace")
        for name in re.findall(r'^\s*(?:Include|Merge)\s+"([^"]+)"', found[path], re.MULTILINE):
            waiting.append(path.parent / name)
    return found


def _read_script(gmsh: Any, script: Path, parameters: Values) -> None:
    """Read a script with its parameters set; one that it does not take is refused."""
    text = "\n".join(script_files(script).values())
    for name, value in parameters.items():
        if not re.search(rf"\b{re.escape(name)}\b", text):
            raise ValueError(f"mesh.parameters.{name}: the script has no such variable")
        if isinstance(value, str):
            gmsh.parser.setString(name, [value])
        else:
            gmsh.parser.setNumber(name, value if isinstance(value, list) else [value])
    gmsh.merge(str(script))
    for name, value in parameters.items():
        get = gmsh.parser.getString if isinstance(value, str) else gmsh.parser.getNumber
        left = [v if isinstance(value, str) else float(v) for v in get(name)]
        if left != (value if isinstance(value, list) else [value]):
            raise ValueError(
                f"mesh.parameters.{name} = {value!r}: the script sets it to {left} itself; "
                f"expected DefineConstant[ {name} = … ] there, which keeps what is given"
            )


def _call(gmsh: Any, function: Callable[..., Any], parameters: Values) -> None:
    """Call a function that builds the model with its parameters."""
    import inspect

    try:
        inspect.signature(function).bind(**parameters)
    except TypeError as error:
        raise ValueError(f"mesh.parameters = {list(parameters)}: {error}") from None
    try:
        function(**parameters)
    except Exception as error:
        called = getattr(function, "__name__", "the function")
        raise ValueError(f"{called}: {type(error).__name__}: {error}") from error
    if not gmsh.isInitialized():
        raise ValueError("the function ended gmsh; expected it to build the model and return")


def _check_cells(gmsh: Any) -> None:
    """Refuse a mesh whose named volumes are not all of hexahedra."""
    groups = gmsh.model.getPhysicalGroups(3)
    if not groups:
        raise ValueError(
            'the model has no physical volume; expected Physical Volume("name") = {…} or '
            "gmsh.model.addPhysicalGroup(3, [...], name=...) for each region"
        )
    volumes = {v for _, tag in groups for v in gmsh.model.getEntitiesForPhysicalGroup(3, tag)}
    count: dict[int, int] = {}
    for volume in volumes:
        for kind, cells, _ in zip(*gmsh.model.mesh.getElements(3, volume), strict=True):
            count[int(kind)] = count.get(int(kind), 0) + len(cells)
    if set(count) != {HEXAHEDRON}:
        kinds = {gmsh.model.mesh.getElementProperties(kind)[0]: n for kind, n in count.items()}
        found = ", ".join(f"{n} of {kind}" for kind, n in kinds.items()) or "no cells"
        raise ValueError(f"gmsh made {found}; expected Hexahedron 8 only: {HINT}")


def _through_a_file(gmsh: Any, names: Iterable[str]) -> HexMesh:
    """Return gmsh's mesh as it is read from a file: the same checks, the same repairs."""
    for option, value in (("MshFileVersion", 2.2), ("Binary", 1), ("SaveAll", 0)):
        gmsh.option.setNumber(f"Mesh.{option}", value)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.msh"
        gmsh.write(str(path))
        return read_write.read(path, names={name: name for name in names})
