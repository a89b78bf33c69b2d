# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact mechanics in closed form and on half-spaces: Hertz, Carter, Kalker, slip waves.

Names are imported when they are first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from contact.theory import kalker as kalker
    from contact.theory.closed_forms import Hertz as Hertz
    from contact.theory.closed_forms import bar_impact as bar_impact
    from contact.theory.closed_forms import carter_creepage as carter_creepage
    from contact.theory.closed_forms import carter_stick_ratio as carter_stick_ratio
    from contact.theory.closed_forms import carter_traction as carter_traction
    from contact.theory.closed_forms import cattaneo_mindlin as cattaneo_mindlin
    from contact.theory.closed_forms import contact_modulus as contact_modulus
    from contact.theory.closed_forms import hertz_ellipse as hertz_ellipse
    from contact.theory.closed_forms import hertz_line as hertz_line
    from contact.theory.closed_forms import hertz_sphere as hertz_sphere
    from contact.theory.closed_forms import line_compression as line_compression
    from contact.theory.closed_forms import sliding_stop as sliding_stop
    from contact.theory.closed_forms import sphere_impact_approach as sphere_impact_approach
    from contact.theory.closed_forms import sphere_impact_time as sphere_impact_time
    from contact.theory.closed_forms import stick_radius_ratio as stick_radius_ratio
    from contact.theory.closed_forms import stick_slip_period as stick_slip_period
    from contact.theory.half_space import HalfSpaceContact as HalfSpaceContact
    from contact.theory.half_space import half_space_contact as half_space_contact
    from contact.theory.kalker import creep_force as creep_force
    from contact.theory.slip_waves import HalfSpace as HalfSpace
    from contact.theory.slip_waves import slip_wave as slip_wave
    from contact.theory.wheel_on_rail import WheelOnRail as WheelOnRail
    from contact.theory.wheel_on_rail import profile_contact as profile_contact

_HOME = {
    "HalfSpace": "slip_waves",
    "HalfSpaceContact": "half_space",
    "Hertz": "closed_forms",
    "WheelOnRail": "wheel_on_rail",
    "bar_impact": "closed_forms",
    "carter_creepage": "closed_forms",
    "carter_stick_ratio": "closed_forms",
    "carter_traction": "closed_forms",
    "cattaneo_mindlin": "closed_forms",
    "contact_modulus": "closed_forms",
    "creep_force": "kalker",
    "half_space_contact": "half_space",
    "hertz_ellipse": "closed_forms",
    "hertz_line": "closed_forms",
    "hertz_sphere": "closed_forms",
    "line_compression": "closed_forms",
    "profile_contact": "wheel_on_rail",
    "sliding_stop": "closed_forms",
    "slip_wave": "slip_waves",
    "sphere_impact_approach": "closed_forms",
    "sphere_impact_time": "closed_forms",
    "stick_radius_ratio": "closed_forms",
    "stick_slip_period": "closed_forms",
}

__all__ = [*_HOME, "kalker"]


def __getattr__(name: str) -> Any:
    if name == "kalker":
        return import_module("contact.theory.kalker")
    if name not in _HOME:
        raise AttributeError(f"module 'contact.theory' has no attribute {name!r}")
    return getattr(import_module(f"contact.theory.{_HOME[name]}"), name)
