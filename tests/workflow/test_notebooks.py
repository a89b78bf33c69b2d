# SPDX-License-Identifier: LGPL-3.0-or-later
"""Each notebook runs from its first cell to its last, and its figures show what it says."""

import runpy

import numpy as np
import pytest

from tests.scripts import EXAMPLES

plt = pytest.importorskip("matplotlib.pyplot")

NOTEBOOKS = EXAMPLES / "notebooks"


@pytest.fixture
def cells(monkeypatch):
    """Run a notebook without a display; return the names that it leaves and its figures."""
    plt.switch_backend("agg")

    figures = []
    monkeypatch.setattr(plt, "show", lambda: figures.extend(map(plt.figure, plt.get_fignums())))

    def run(name):
        plt.close("all")
        left = runpy.run_path(str(NOTEBOOKS / f"{name}.py"))
        assert figures and all(figure.axes for figure in figures)
        return left

    yield run
    plt.close("all")


def test_every_notebook_is_run():
    """A new notebook needs a test here; none is without a heading and something to try."""
    with open(__file__, encoding="utf-8") as file:
        text = file.read()
    for path in NOTEBOOKS.glob("*.py"):
        assert f'cells("{path.stem}")' in text
        written = path.read_text("utf-8")
        assert "# %% [markdown]\n# # " in written
        assert "# **Try**" in written


def test_hertz(cells):
    """The pressure of inner nodes is Hertz' to 3 % of p₀, the load that of the scene to 1e-3."""
    left = cells("hertz")
    r, pressure, exact = left["r"], left["pressure"], left["exact"]
    inner = r < 0.7 * exact.a
    off = pressure[inner] - exact.pressure(r[inner], 0 * r[inner])
    assert inner.sum() > 5
    assert np.abs(off).max() < 0.03 * exact.p0
    assert left["load"] == pytest.approx(12.3e3, rel=2e-3)


@pytest.mark.slow
@pytest.mark.long
def test_carter(cells):
    """Shear at the nodes is Carter's to 5 % of friction p₀, rms; steady in the last tenth."""
    left = cells("carter")
    exact = left["carter_traction"](left["x"] - left["middle"], left["hertz"], left["ratio"], 0.3)
    rms = np.sqrt(np.mean((left["shear"] - exact) ** 2))
    assert rms < 0.05 * 0.3 * left["hertz"].p0
    assert np.ptp(left["Q"][-7:]) < 0.03 * abs(left["Q"][-1])  # nodes pass


@pytest.mark.slow
@pytest.mark.long
def test_flange(cells):
    """A second patch is born on the gauge corner and bears a third of the load or more."""
    left = cells("flange")
    patches, steep = left["patches"], left["steep"]
    assert steep.any() and not steep[0]
    assert patches["normal_force"][steep].max() > 25e3
    assert "birth" in {kind.decode() for kind in left["events"]["kind"]}
