# SPDX-License-Identifier: LGPL-3.0-or-later
"""Elastic bodies in explicit dynamics: UFL forms, compiled cell kernels, loads, springs.

Names are imported when they are first used: UFL and DOLFINx are loaded only then.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from forms.cells import one_point as one_point
    from forms.cells import uniform as uniform
    from forms.elasticity import Elastic as Elastic
    from forms.elasticity import full as full
    from forms.elements import LAWS as LAWS
    from forms.elements import Law as Law
    from forms.elements import internal_work as internal_work
    from forms.elements import strain_energy as strain_energy
    from forms.kernel import CellIntegral as CellIntegral
    from forms.kernel import CellKernel as CellKernel
    from forms.loads import nodal_traction as nodal_traction
    from forms.mass import lumped_mass as lumped_mass
    from forms.materials import Orthotropic as Orthotropic
    from forms.springs.connections import Connections as Connections
    from forms.springs.point_masses import PointMasses as PointMasses
    from forms.springs.springs import Springs as Springs
    from forms.time_step import assembled_frequency as assembled_frequency
    from forms.time_step import cell_frequency as cell_frequency
    from forms.time_step import stable_step as stable_step

_HOME = {
    "CellIntegral": "kernel",
    "CellKernel": "kernel",
    "Connections": "springs.connections",
    "Elastic": "elasticity",
    "LAWS": "elements",
    "Law": "elements",
    "Orthotropic": "materials",
    "PointMasses": "springs.point_masses",
    "Springs": "springs.springs",
    "assembled_frequency": "time_step",
    "cell_frequency": "time_step",
    "full": "elasticity",
    "internal_work": "elements",
    "lumped_mass": "mass",
    "nodal_traction": "loads",
    "one_point": "cells",
    "stable_step": "time_step",
    "strain_energy": "elements",
    "uniform": "cells",
}

__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'forms' has no attribute {name!r}")
    return getattr(import_module(f"forms.{_HOME[name]}"), name)
