# SPDX-License-Identifier: LGPL-3.0-or-later
# %% [markdown]
# # Hertz in ten lines
#
# A steel ball of 100 mm radius is pressed on a flat with 12.3 kN; a quarter of both is modelled.
# Hertz (1882): the pressure is $p_0 \sqrt{1 - r^2/a^2}$ over a circle of radius $a$.
#
# This file is a notebook kept as text: Jupyter opens it with jupytext, VS Code as it is, and
# `python examples/notebooks/hertz.py` runs it.

# %%
import tempfile
from pathlib import Path

from mpi4py import MPI  # noqa: F401  before what is linked with its library

import matplotlib.pyplot as plt
import numpy as np

from contact.theory import contact_modulus, hertz_sphere
from workflow import Scene, run

# %% [markdown]
# The scene is one of those that come with squealx. `with_` changes keys of it; here the field files
# are left out, because a plot of the contact does not need them.

# %%
scene = Scene.load("hertz").with_(**{"output.fields": False})
folder = Path(tempfile.mkdtemp()) / "hertz"
result = run(scene, folder, quiet=True)
[(e["quantity"], f"{e['error']:+.2%}") for e in result.summary["expected"]]

# %% [markdown]
# `footprint` has the nodes in contact at an output: positions, forces, areas. The pressure of a
# node is its force over its area.

# %%
touch = result.footprint("touch", 0)
r = np.hypot(*touch["position"][:, :2].T)
pressure = touch["normal_force"] / touch["area"]
load = 4 * touch["normal_force"].sum()  # of all four quarters
exact = hertz_sphere(load, 0.1, contact_modulus(210e9, 0.3, 210e9, 0.3))

# %%
line = np.linspace(0, exact.a, 200)
fig, axes = plt.subplots(figsize=(5, 3.2), layout="constrained")
axes.plot(line * 1e3, exact.pressure(line, 0 * line) / 1e6, lw=3, color="0.7", label="Hertz")
axes.plot(r * 1e3, pressure / 1e6, ".", label="nodes of the ball")
axes.set(xlabel="distance from the middle [mm]", ylabel="pressure [MPa]")
axes.legend()

# %%
plt.show()

# %% [markdown]
# **Try**: `"mesh.size": 5e-4` (how far off are the outermost nodes?), another `mesh.radius`,
# `"contacts.touch.penalty": 0.1` (the springs of the contact give way: what happens to $p_0$?).
