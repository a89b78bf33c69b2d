# SPDX-License-Identifier: LGPL-3.0-or-later
"""Wheel and rail at rest in two patches: row 25."""

from typing import Any

import numpy as np

from meshes.profiles.placement import RADIUS, lateral_shift_for
from workflow import Scene, build, rest

YAW, LOAD, MASS = 0.02, 100e3, 518.0  # rad, N, of the half wheelset [kg]
STEEL = {"youngs_modulus": 210e9, "poisson_ratio": 0.3, "density": 7800.0}


def two_patches(pressed: float, size: float, strip: float | None, **changes: Any) -> Scene:
    """A wheel at 20 mrad on a short rail, 100 kN heavy, its flange ``pressed`` into the corner [m].

    The rail's foot and the axle are held, so that nothing but the contact gives way.
    """
    shift = lateral_shift_for(flange_gap=-pressed, yaw=YAW).shift
    mesh = {
        "kind": "wheel-on-rail",
        "size": size,
        "rail_length": 1.0,
        "start": 0.0,
        "lateral_shift": shift,
        "margin": 0.02,
    }
    if strip is not None:
        mesh["strip"] = {"size": strip}
    bodies = {
        "wheelset": {"regions": ["tyre", "web", "hub", "axle"], "material": STEEL},
        "rail": {"regions": ["rail_head", "rail_web", "rail_foot"], "material": STEEL},
    }
    tables = {
        "name": "two-patches",
        "title": "Two patches at rest",
        "gravity": [0.0, 0.0, -LOAD / MASS],
        "mesh": mesh,
        "bodies": bodies,
        "contacts": {
            "wheel_rail": {
                "contactor": "tread",
                "target": "railhead",
                "method": "implicit-penalty",
                "penalty": 30.0,
            }
        },
        "supports": [
            {"surface": "foot_underside", "directions": ["x", "y", "z"]},
            {"surface": "axle_inner", "directions": ["x", "axle"]},
        ],
        "rolling": {
            "body": "wheelset",
            "driven_region": "axle",
            "speed": 0.0,
            "angle_of_attack": YAW,
        },
        "equilibrium": {"approach": {"wheelset": [0.0, 0.0, -5e-5]}, "tolerance": 1e-5},
        "time": {"end": 1e-6, "output_interval": 1e-6},
    }
    return Scene.check(tables).with_(**changes)


def measured(scene: Scene, log: Any = lambda line: None) -> list[dict[str, float]]:
    """Force, area, pressures and half axes of both patches at rest, rail top first."""
    model = build(scene, log=log)
    rest(model, log)
    pair = model.pairs["wheel_rail"]
    nodes, angle = pair.footprint(), []
    found = []
    for patch in np.unique(nodes.patch):
        mine = nodes.patch == patch
        force, x = nodes.normal_force[mine], nodes.position[mine]
        normal = force @ nodes.normal[mine]
        across = np.cross(normal, [1.0, 0.0, 0.0])
        across /= np.linalg.norm(across)
        plane = np.column_stack([x[:, 0], x @ across])
        plane -= force @ plane / force.sum()
        axes = np.sqrt(5 * np.linalg.eigvalsh((force[:, None] * plane).T @ plane / force.sum()))
        found.append(
            {
                "force": float(force.sum()),
                "nodes": int(mine.sum()),
                "area": float(nodes.area[mine].sum()),
                "moment_area": float(np.pi * axes.prod()),
                "a": float(axes[1]),
                "b": float(axes[0]),
                "peak": float((force / nodes.area[mine]).max()),
                "angle": float(np.degrees(np.arctan2(abs(normal[1]), normal[2]))),
                "give": pair.max_penetration,
                "y": float(force @ x[:, 1] / force.sum()),
                "cells": len(model.domain.source.cells),
            }
        )
    return sorted(found, key=lambda patch: patch["angle"])
