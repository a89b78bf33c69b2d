# SPDX-License-Identifier: LGPL-3.0-or-later
# %% [markdown]
# # One patch becomes two
#
# Half a wheelset in a tight curve, cells of 8 mm along the rail: far too coarse to quote a pressure
# (its error is a quarter), enough to see what happens. It starts 0.4 mm before the flange meets the
# gauge corner. Some minutes on one core.
#
# This file is a notebook kept as text: Jupyter opens it with jupytext, VS Code as it is, and
# `python examples/notebooks/flange.py` runs it.

# %%
import tempfile
from pathlib import Path

from mpi4py import MPI  # noqa: F401  before what is linked with its library

import matplotlib.pyplot as plt
import numpy as np

from workflow import Scene, run

# %%
scene = Scene.load("flange-transition").with_(
    **{
        "mesh.size": 8e-3,
        "mesh.flange_gap": 4e-4,
        "time.end": 1.5e-3,
        "time.output_interval": 1e-4,
        "output.fields": False,
    }
)
result = run(scene, Path(tempfile.mkdtemp()) / "flange", quiet=True)
f"{result.summary['cells']} cells, {result.summary['steps']} steps"

# %% [markdown]
# `patches` is a table, a row for each patch and output. The gauge corner's patch is the steep one.

# %%
patches = result.patches("wheel_rail")
steep = patches["contact_angle"] > np.radians(50)
t = patches["t"] * 1e3

fig, (force, power) = plt.subplots(2, 1, figsize=(5, 5), layout="constrained", sharex=True)
force.plot(t[~steep], patches["normal_force"][~steep] / 1e3, "o-", label="rail top")
force.plot(t[steep], patches["normal_force"][steep] / 1e3, "o-", label="gauge corner")
force.set(ylabel="normal force [kN]", ylim=(0, None))
force.legend()
power.plot(result.history["t"] * 1e3, result.history["friction_dissipation"])
power.set(xlabel="time [ms]", ylabel="dissipated by friction [J]")

# %% [markdown]
# Where the wheel touches, as events: births, splits, merges and ends of patches.

# %%
events = result.events("wheel_rail")
[(f"{time * 1e3:.2f} ms", kind) for time, kind in zip(events["t"], events["kind"], strict=True)]

# %%
plt.show()

# %% [markdown]
# **Try**: `"rolling.angle_of_attack": 0.01` (later, and softer);
# `"contacts.wheel_rail.friction": 0.3`; `"mesh.size": 4e-3`, which is the scene as shipped.
