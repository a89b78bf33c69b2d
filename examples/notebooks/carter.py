# SPDX-License-Identifier: LGPL-3.0-or-later
# %% [markdown]
# # Carter and his slip zone
#
# A driven roller on a flat, plane strain. Its rim runs faster than the flat by a creepage of
# $7.6 \cdot 10^{-4}$. Carter (1926): the leading part of the contact sticks; behind it the surfaces
# slip and the shear is friction times pressure. The traction is the difference of two ellipses.
#
# This file is a notebook kept as text: Jupyter opens it with jupytext, VS Code as it is, and
# `python examples/notebooks/carter.py` runs it.

# %%
import tempfile
from pathlib import Path

from mpi4py import MPI  # noqa: F401  before what is linked with its library

import matplotlib.pyplot as plt
import numpy as np

from contact.theory import carter_stick_ratio, carter_traction, contact_modulus, hertz_line
from workflow import Scene, run

friction, radius = 0.3, 0.46  # [-], [m]

# %%
scene = Scene.load("carter").with_(**{"output.fields": False})
result = run(scene, Path(tempfile.mkdtemp()) / "carter", quiet=True)
f"{result.summary['steps']} steps of {result.summary['dt'] * 1e9:.0f} ns"

# %% [markdown]
# ## The force builds up
#
# At the start nothing has slipped yet. Every particle that enters the contact sticks, is sheared
# more and more on its way through, and slips when the pressure behind can no longer hold it.

# %%
history = result.history
width = scene.mesh.y[1]  # of the slice of plane strain
P = history["touch_normal_force"] / width
Q = history["touch_tangential_x_force"] / width
hertz = hertz_line(P[-1], radius, contact_modulus(210e9, 0.3, 210e9, 0.3))

fig, axes = plt.subplots(figsize=(5, 3), layout="constrained")
axes.plot(80 * history["t"] / (2 * hertz.a), np.abs(Q) / (friction * P))
axes.set(xlabel="lengths of the contact rolled", ylabel="Q / (friction P)", ylim=(0, 1))

# %% [markdown]
# ## The slip zone

# %%
touch = result.footprint("touch", len(history["t"]) - 1)
x = touch["position"][:, 0]
middle = np.average(x, weights=touch["normal_force"])
shear = np.abs(touch["tangential_force"][:, 0]) / touch["area"]
ratio = carter_stick_ratio(Q[-1], P[-1], friction)

line = np.linspace(-hertz.a, hertz.a, 400)
fig, axes = plt.subplots(figsize=(5, 3.2), layout="constrained")
exact = carter_traction(line, hertz, ratio, friction)
axes.plot(line * 1e3, exact / 1e6, lw=3, color="0.7", label="Carter")
axes.plot(line * 1e3, friction * hertz.pressure(line) / 1e6, "--", color="0.5", label="friction p")
axes.plot((x - middle) * 1e3, shear / 1e6, ".", label="nodes")
axes.set(xlabel="along the flat, rolling to the right [mm]", ylabel="shear [MPa]", ylim=(0, None))
axes.legend()
f"sticks over {ratio:.0%} of the contact"

# %%
plt.show()

# %% [markdown]
# **Try**: twice the creepage, `"driven.roller.spin": [0.0, 174.178, 0.0]` (when does the whole
# contact slip?); `"mesh.size": 6e-4`.
