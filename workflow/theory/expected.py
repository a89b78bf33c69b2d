# SPDX-License-Identifier: LGPL-3.0-or-later
"""The answers that theory has for a run, beside what came out.

A closed form is chosen by what the scene is: its mesh, bodies, loads and motion. Each function
yields nothing where its assumptions do not hold, or where the run is too short for what it tells.
"""

from collections.abc import Callable, Iterator

from workflow.results.record import Record
from workflow.scene.mesh import (
    BarMesh,
    BlocksMesh,
    CapMesh,
    CurvedMesh,
    Foreign,
    HollowSphereMesh,
    WheelRailMesh,
)
from workflow.scene.scene import Scene
from workflow.theory.quantity import Expected

Answers = Callable[[Record], Iterator[Expected]]


def expected(record: Record) -> list[Expected]:
    """Return the quantities of a run that theory has answers for; the first tells most of it.

    The laws of the scene file are taken for those of the run.
    """
    if not len(record.history.get("t", ())):
        return []
    if record.checked.passes and record.checked.passes.after:
        return []  # its steel has a history that no theory here knows
    found = [answer for answers in theories(record.checked) for answer in answers(record)]
    return [answer for answer in found if answer.finite]


def theories(scene: Scene) -> tuple[Answers, ...]:
    """Return the theories of scenes with such a mesh; imported only then.

    The first quantity of the first that has answers is what runs of a study are compared by.
    """
    match scene.mesh:
        case BarMesh():
            if not scene.contacts:
                from workflow.theory.waves import held_bar

                return (held_bar,)
            from workflow.theory.bars import bar_on_wall, yielding_bar_on_wall
            from workflow.theory.blocks import slip_weakening, stick_slip

            return bar_on_wall, yielding_bar_on_wall, stick_slip, slip_weakening
        case BlocksMesh():
            from workflow.theory.bars import two_bars
            from workflow.theory.blocks import contact_patch, sliding_block

            return two_bars, contact_patch, sliding_block
        case CapMesh() | CurvedMesh():
            from workflow.theory.rolling import carter, creep_force, half_space_code
            from workflow.theory.smooth import hertz_contact, shifted, struck

            return struck, shifted, carter, creep_force, half_space_code, hertz_contact
        case _ if isinstance(scene.mesh, Foreign):
            from workflow.theory.bars import taylor_bar
            from workflow.theory.smooth import hertz_contact
            from workflow.theory.yielding_sphere import flattened_sphere

            return taylor_bar, flattened_sphere, hertz_contact
        case HollowSphereMesh():
            from workflow.theory.spheres import yielding_sphere

            return (yielding_sphere,)
        case WheelRailMesh():
            from workflow.theory.wheel_on_rail import wheel_at_rest, wheel_rolling

            return wheel_at_rest, wheel_rolling
    return ()
