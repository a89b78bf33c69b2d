# SPDX-License-Identifier: LGPL-3.0-or-later
"""Results in Python: tables of a run as arrays, as pandas wants them, and what is not there."""

import sys

import numpy as np
import pytest

from workflow import read_run
from workflow.results.result import Result

SLIDING = {"time.end": 20e-6, "time.output_interval": 5e-6}


@pytest.fixture(scope="module")
def result(run_scene) -> Result:
    """A block that slides on a base."""
    return read_run(run_scene("sliding-block", **SLIDING))


def test_history_is_a_table_with_units(result):
    """A dict of arrays, one row an output, with units: names of forces end so, and are in N."""
    history = result.history
    np.testing.assert_allclose(history["t"], np.arange(5) * 5e-6, atol=1e-12)
    assert {len(column) for column in history.values()} == {5}
    assert history.units["t"] == "s" and history.units["kinetic"] == "J"
    assert {unit for name, unit in history.units.items() if name.endswith("_force")} == {"N"}
    assert history.flat().keys() == history.keys()


def test_tables_of_a_pair(result):
    """Patches, events and nodes; vectors are as many columns, and bytes text."""
    patches, events = result.patches("face"), result.events("face")
    assert len(patches["t"]) == 5 and patches.units["friction_power"] == "W"
    flat = patches.flat()
    np.testing.assert_array_equal(flat["force_2"], patches["force"][:, 2])
    assert "force" not in flat and {array.ndim for array in flat.values()} == {1}
    assert events.flat()["kind"].tolist() == ["birth"]
    nodes = result.footprint("face", 3)
    force = (nodes["normal_force"][:, None] * nodes["normal"] + nodes["tangential_force"]).sum(
        axis=0
    )
    on_block = [result.history[f"contact_on_block_{axis}_force"][3] for axis in "xyz"]
    np.testing.assert_allclose(force, on_block, atol=1e-9 * abs(on_block[2]))


def test_what_is_not_there_is_named(result):
    """An unknown pair or output is an error that tells which there are."""
    with pytest.raises(KeyError, match=r"no 'wall' in patches, which has \['face'\]"):
        result.patches("wall")
    with pytest.raises(KeyError, match="no '5' in contact/face"):
        result.footprint("face", 5)


def test_as_pandas(result):
    """A frame with a column for each flat one and the units beside it."""
    pytest.importorskip("pandas")
    frame = result.patches("face").to_pandas()
    np.testing.assert_array_equal(frame["force_0"], result.patches("face")["force"][:, 0])
    assert len(frame) == 5 and frame.attrs["units"]["force"] == "N"
    assert frame.set_index("t").index[0] == 0.0


def test_without_pandas_it_says_so(result, monkeypatch):
    """The name of what is missing, how to get it, and what does without."""
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ModuleNotFoundError, match=r"expected pandas.*pip install pandas.*flat"):
        result.history.to_pandas()
