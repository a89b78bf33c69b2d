# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of two surfaces in explicit dynamics; closed forms in :mod:`contact.theory`.

Names are imported when they are first used: a scene without contact pays nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from contact import theory as theory
    from contact.footprint import Footprint as Footprint
    from contact.footprint import Patch as Patch
    from contact.friction import LawState as LawState
    from contact.friction import coulomb as coulomb
    from contact.friction import exponential as exponential
    from contact.friction import rational as rational
    from contact.friction import tabulated as tabulated
    from contact.friction import with_memory as with_memory
    from contact.pair import ContactPair as ContactPair
    from contact.surface import Surface as Surface
    from contact.surface import rigid_plane as rigid_plane

_HOME = {
    "ContactPair": "pair",
    "Footprint": "footprint",
    "LawState": "friction",
    "Patch": "footprint",
    "Surface": "surface",
    "coulomb": "friction",
    "exponential": "friction",
    "rational": "friction",
    "rigid_plane": "surface",
    "tabulated": "friction",
    "with_memory": "friction",
}

__all__ = [*_HOME, "theory"]


def __getattr__(name: str) -> Any:
    if name == "theory":
        return import_module("contact.theory")
    if name not in _HOME:
        raise AttributeError(f"module 'contact' has no attribute {name!r}")
    return getattr(import_module(f"contact.{_HOME[name]}"), name)
