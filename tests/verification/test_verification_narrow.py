# SPDX-License-Identifier: LGPL-3.0-or-later
"""Verification of contact without give: rows 27 (landing), 28 (give), 29 (node passing).

The springs of ``implicit-penalty`` at the whole step; rows 14 to 16 with them besides.
"""

from pathlib import Path

import numpy as np
import pytest

from contact.theory.closed_forms import contact_modulus, hertz_sphere
from workflow import Scene, run


def watched(
    folder: Path, name: str, probe, penalty: float = 30.0, **changes
) -> tuple[dict, np.ndarray]:
    """Summary of a quiet run, and what ``probe(pair)`` returned at every step, as columns."""
    rows: list = []
    scene = Scene.load(name, **{"output.fields": False}, **changes)
    pair = next(iter(scene.contacts))
    springs = {"method": "implicit-penalty", "penalty": penalty}
    keys = {f"contacts.{pair}.{key}": value for key, value in springs.items()}
    result = run(
        scene.with_(**keys), folder, watch=lambda m: rows.append(probe(m.pairs[pair])), quiet=True
    )
    return result.summary, np.array(rows).T


# row 27

LANDED = 1.5e-3  # of the work of friction: 1.1e-3 at 2.5 mm, 0.7e-3 at 1.25 mm


def landing(
    folder: Path, size: float, penalty: float = 10.0, points: str = "nodes"
) -> tuple[float, float]:
    """Energy lost by a sliding block's landings over the work of friction, and balance error."""
    sizes = {"mesh.size": size, "mesh.base_size": 1.24 * size, "contacts.face.points": points}
    summary, (lost, heat) = watched(
        folder,
        "sliding-block",
        lambda pair: (pair.damping_dissipation, pair.friction_dissipation),
        penalty,
        **sizes,
    )
    return lost[-1] / heat[-1], summary["energy"]["balance_error"]


@pytest.mark.parametrize("points", ["nodes", "quadrature"])
def test_row_27_landings_lose_little_and_less_on_a_finer_mesh(tmp_path, points):
    """Nodes that land, slip and lift off lose 1e-3 of the work of friction, and give nothing.

    Points in the facets as little.
    """
    coarse, fine = (
        landing(tmp_path / str(size), size, points=points) for size in (2.5e-3, 1.25e-3)
    )
    assert 0 < fine[0] < coarse[0] < LANDED
    assert max(abs(coarse[1]), abs(fine[1])) < 1e-12


def test_row_27_the_ball_that_bounces(tmp_path):
    """The impact of a sphere loses 1.4e-4 and 3e-5 of its energy; the balance closes to 1e-12."""

    def lost(size):
        summary, (loss,) = watched(
            tmp_path / str(size),
            "sphere-impact",
            lambda pair: (pair.damping_dissipation,),
            **{"mesh.size": size},
        )
        assert abs(summary["energy"]["balance_error"]) < 1e-12
        return loss[-1] / summary["energy"]["kinetic"]

    coarse, fine = lost(5.6e-4), lost(2.8e-4)
    assert 0 < fine < coarse / 2 < 1e-4


# row 28


@pytest.mark.parametrize(("size", "share"), [(1e-3, 0.012), (5e-4, 0.01)])
def test_row_28_give_of_hertz(tmp_path, size, share):
    """Overlap of 1 % of Hertz' approach and less, and the run keeps the static pressure."""
    summary, (force, overlap) = watched(
        tmp_path,
        "hertz",
        lambda pair: (pair.normal_force, pair.max_penetration),
        **{"mesh.size": size, "time.safety": 0.9},
    )
    approach = hertz_approach(force[0])
    assert overlap[1:].max() < share * approach
    np.testing.assert_allclose(force, force[0], rtol=1e-3)
    assert abs(summary["energy"]["balance_error"]) < 1e-12


def hertz_approach(quarter: float) -> float:
    """Approach of the scene's sphere under four times the load of its quarter model [m]."""
    steel = contact_modulus(210e9, 0.3, 210e9, 0.3)
    return hertz_sphere(4 * quarter, Scene.load("hertz").mesh.radius, steel).approach


# row 29

CELL, SPEED = 6e-4, 80.0


def ripple(folder: Path, spin: float, rates: tuple[float, float], **contact) -> float:
    """Largest line of the normal force at ``rates`` [SPEED / CELL] over its mean [dB]."""
    changes = {f"bodies.{b}.stiffness_damping": 0.0 for b in ("roller", "block")}
    changes |= {"mesh.size": CELL, "time.safety": 0.9, "driven.roller.spin": [0.0, spin, 0.0]}
    changes |= {f"contacts.touch.{key}": value for key, value in contact.items()}
    summary, (force,) = watched(folder, "carter", lambda pair: (pair.normal_force,), **changes)
    late = force[len(force) // 2 :]
    window = np.hanning(len(late))
    lines = 2 * np.abs(np.fft.rfft((late - late.mean()) * window)) / window.sum()
    rate = np.fft.rfftfreq(len(late), summary["dt"]) * CELL / SPEED
    return 20 * np.log10(lines[(rate > rates[0]) & (rate < rates[1])].max() / late.mean())


@pytest.mark.parametrize("spin", [174.045, 182.0], ids=["partial slip", "full slip"])
def test_row_29_node_passing(tmp_path, spin):
    """Normal force at the rate of passing nodes: below −40 dB of the mean (−58 and −42).

    Found at 139 kHz, near which the undamped bodies ring whatever the spin.
    """
    assert ripple(tmp_path, spin, (0.9, 1.1)) < -40


def test_row_29_points_pass_more_quietly_than_nodes(tmp_path):
    """The roller's nodes pass at 153 kHz, away from that: −48 dB, points in its facets −61 dB."""
    rates, spin = (1.1, 1.2), 200.0
    nodes, points = (
        ripple(tmp_path / kind, spin, rates, friction=0.0, points=kind)
        for kind in ("nodes", "quadrature")
    )
    assert points < -58 < -50 < nodes


# rows 14 to 16, which have tests of their own with the springs of ``penalty``

WITHIN = {
    "carter": ({"mesh.size": 6e-4}, {"creepage for the traction": 0.02}),
    "cattaneo-mindlin": ({"mesh.size": 5e-4}, {"radius of the stick zone": 0.04}),
}


@pytest.mark.parametrize("name", WITHIN)
def test_rows_14_and_15_at_the_whole_step(tmp_path, name):
    """As right at the step of the bodies alone, without damping: a third of the steps and less."""
    sizes, allowed = WITHIN[name]
    undamped = {f"bodies.{body}.stiffness_damping": 0.0 for body in Scene.load(name).bodies}
    summary, _ = watched(
        tmp_path, name, lambda pair: (0.0,), **sizes, **undamped, **{"time.safety": 0.9}
    )
    errors = {answer["quantity"]: answer["error"] for answer in summary["expected"]}
    for quantity, limit in allowed.items():
        assert abs(errors[quantity]) < limit
    assert abs(summary["energy"]["balance_error"]) < 1e-7
