# SPDX-License-Identifier: LGPL-3.0-or-later
"""Errors as users see them: an exit code and one paragraph, never a traceback."""

import errno
import sys
import tempfile
import traceback

from workflow.scene.units import SceneError

LONGEST = 3000  # characters of a message
FENICSX = ("mpi4py", "petsc4py", "slepc4py", "dolfinx", "basix", "ufl", "ffcx", "dolfinx_solver")
EXTRAS = {
    **dict.fromkeys(FENICSX, "fenicsx"),
    **dict.fromkeys(("gmsh", "meshio"), "mesh"),
    **dict.fromkeys(("pyvista", "vtk", "vtkmodules", "matplotlib", "jinja2", "PIL"), "figures"),
    **dict.fromkeys(("skfem", "jax"), "bench"),
}


def told(error: BaseException) -> tuple[int, str]:
    """Return the exit code of an error and what to say of it."""
    code, message = _told(error)
    if len(message) > LONGEST:
        message = f"{message[: LONGEST - 500]} … {message[-480:]}"
    return code, message


def _told(error: BaseException) -> tuple[int, str]:
    if isinstance(error, SceneError) or _is_a(error, "forms.simd.cache", "CompilerError"):
        return 2, str(error)
    if _is_a(error, "workflow.simulation.guards", "GuardError"):
        return 3, str(error)
    if isinstance(error, ModuleNotFoundError):
        if extra := EXTRAS.get((error.name or "").split(".")[0]):
            debian = " or, on Debian, apt install python3-dolfinx" if extra == "fenicsx" else ""
            return 2, f"{error.name} is not installed: pip install 'squealx[{extra}]'{debian}"
    if isinstance(error, MemoryError):
        return 3, "out of memory; expected fewer cells, or a machine with more"
    if isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
        return 2, f"{error.filename}: {error.strerror}; expected a shorter path"
    if isinstance(error, OSError) and error.errno in _SAID:
        where = error.filename or "output"
        return 3, f"{where}: {error.strerror}; expected room and permission there"
    return 3, _unexpected(error)


_SAID = (errno.ENOSPC, errno.EDQUOT, errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOTDIR)


def _is_a(error: BaseException, module: str, name: str) -> bool:
    """Tell whether an error is of a class whose module, once it was raised, is imported."""
    return isinstance(error, getattr(sys.modules.get(module), name, ()))


def _unexpected(error: BaseException) -> str:
    """Keep the traceback of an error that nobody expected; return what to do with it."""
    text = "".join(traceback.format_exception(error))
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="squealx-error-", suffix=".txt", delete=False, encoding="utf-8"
        ) as file:
            file.write(text)
        where = f"what led to it is in {file.name}"
    except OSError:
        where = text.strip().splitlines()[-3].strip()
    return (
        f"{type(error).__name__}: {error}: nobody expected this. A file that was read may be "
        f"damaged, or squealx is at fault: please report it; {where}"
    )
