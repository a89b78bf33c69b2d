# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of the results of a run, each against a limit."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from workflow.report.tables import number
from workflow.results.batch import opened
from workflow.results.record import Contact, Record
from workflow.theory.smooth import applied
from workflow.theory.wheel_on_rail import weight_on_rail

LOAD = 0.01  # of the load, that a contact at rest may be off by
ROUND_OFF = 1e-9  # of the largest force


@dataclass(frozen=True)
class Check:
    """One check.

    Attributes:
        name: What is checked.
        value: What was found, in words.
        limit: What is allowed, in words.
        passed: Whether it is within; None where that cannot be told.
        how: How it was computed.
    """

    name: str
    value: str
    limit: str
    passed: bool | None
    how: str


def checks(record: Record, summary: dict[str, Any]) -> list[Check]:
    """Return the checks that make sense for a run."""
    found = [_ended(record, summary)]
    if "dt" in summary:
        share = summary["dt"] / summary["dt_bound"]
        how = f"step over its stability bound ({record.checked.time.bound})"
        found.append(Check("stable step", number(share), "at most 1", share <= 1, how))
    if len(record.history.get("t", ())):
        found += [*_energy(record), *_friction_work(record)]
        for name in record.checked.contacts:
            found += _penetration(record, name)
    for name, contact in record.contacts.items():
        found += [*_cone(record, name), *_load(record, name, contact)]
    return found


def _ended(record: Record, summary: dict[str, Any]) -> Check:
    t = record.history.get("t", np.zeros(0))
    end, last = record.checked.time.end, float(t[-1]) if len(t) else 0.0
    value = f"last output at {number(last * 1e3)} ms"
    done = summary.get("status") == "done"
    return Check("ran to its end", value, f"{number(end * 1e3)} ms", done, "status of the run")


def _energy(record: Record) -> Iterator[Check]:
    worst = float(np.max(np.abs(record.history["balance_error"])))
    limit = record.checked.guards.energy_error
    how = "largest error of the balance at any output, over the largest energy exchanged"
    most = f"at most {number(limit)}"
    yield Check("energy balance", number(worst, 3), most, worst <= limit, how)
    if np.any(record.history.get("contact_work", 0.0)):
        worst = float(np.max(np.abs(record.history["guarded_error"])))
        how = "largest error of the balance at any output, over the work that contact has done"
        yield Check("energy of the contact", number(worst, 3), most, worst <= limit, how)


def _friction_work(record: Record) -> Iterator[Check]:
    work = record.history["friction_dissipation"]
    if not np.any(work):
        return
    back = float(max(-np.min(np.diff(work), initial=0.0), 0.0)) / float(np.max(np.abs(work)))
    how = "largest fall of the dissipated energy between outputs, over its largest value"
    limit = f"at most {number(ROUND_OFF)}"
    yield Check("friction takes energy", number(back, 3), limit, back <= ROUND_OFF, how)


def _penetration(record: Record, name: str) -> Iterator[Check]:
    deepest = float(np.max(record.history.get(f"{name}_max_penetration", np.zeros(1))))
    contact = record.contacts.get(name)
    if contact is None:
        return
    areas = np.concatenate([p.areas for o in contact.patches for p in o.values()])
    share = deepest / float(np.sqrt(np.median(areas)))
    limit = record.checked.guards.penetration
    value = f"{number(share, 3)} ({number(deepest * 1e6, 3)} µm)"
    how = "deepest node of any output over the median edge of the cells in contact"
    told = f"penetration of {name}, in cells"
    yield Check(told, value, f"at most {number(limit)}", share <= limit, how)


def _cone(record: Record, name: str) -> Iterator[Check]:
    """Compare tangential forces with friction times normal force, node by node."""
    excess, largest = -np.inf, 0.0
    with opened(record.folder / "results.h5") as file:
        for group in file[f"contact/{name}"].values():
            normal = group["normal_force"][:]
            if "friction" not in group or not len(normal):
                continue
            shear = np.linalg.norm(group["tangential_force"][:], axis=1)
            excess = max(excess, float(np.max(shear - group["friction"][:] * normal)))
            largest = max(largest, float(np.max(normal)))
    if not largest:
        return
    how = "largest of tangential force less friction × normal force, over the largest normal force"
    value, limit = excess / largest, f"at most {number(ROUND_OFF)}"
    yield Check(f"friction cone of {name}", number(value, 3), limit, value <= ROUND_OFF, how)


def _load(record: Record, name: str, contact: Contact) -> Iterator[Check]:
    """Compare the vertical force on a contact at rest with what rests on it."""
    if record.checked.equilibrium is None or contact.t[0] != 0 or not contact.patches[0]:
        return
    weight, dead = weight_on_rail(record), applied(record)
    force = sum(p.vertical_force for p in contact.patches[0].values())
    load = weight if weight is not None else dead
    if load is None:
        return
    what = "weight of wheelset and sprung mass" if weight is not None else "load on the top"
    error = force / load - 1
    value = f"{number(force / 1e3, 5)} kN, {number(100 * error, 2)} % off"
    limit = f"{number(load / 1e3, 5)} kN ± {100 * LOAD:g} %"
    how = f"vertical nodal forces of the first output against the {what}"
    yield Check(f"load on {name} at rest", value, limit, abs(error) <= LOAD, how)
