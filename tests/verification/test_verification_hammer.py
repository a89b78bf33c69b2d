# SPDX-License-Identifier: LGPL-3.0-or-later
"""Verification row 41: the track under a hammer against beams on sleepers spread and apart.

The scene track-hammer with sleepers as point masses, which is what the beams know. A continuous
support has no sleepers to lie between: half way between two of them the same beam on sleepers that
lie apart is off it by -11 to +17 dB from 200 Hz on, and over one by 3 dB at 200 Hz. So the run is
held against the continuous beam where both beams agree to 1 dB, and against the other throughout.
"""

from pathlib import Path

import numpy as np
import pytest

from workflow import Scene, run
from workflow.results.receptance import Receptance, bands, decay_rates, peaks, rates, receptance
from workflow.results.record import Record
from workflow.results.samples import read
from workflow.theory.track_beam import TrackBeam, of_scene

WEB = "web_0_00"
AUDIBLE = (20.0, 2000.0)


def on_point_masses(**changes) -> Scene:
    """The scene with its sleepers as point masses, as the beams have them."""
    tables = Scene.load("track-hammer").tables()
    del tables["bodies"]["sleepers"], tables["mesh"]["sleepers"], tables["supports"]
    del tables["track"]["sleeper_top"], tables["track"]["sleeper_bottom"]
    tables["track"] |= {"sleeper_mass": 219.0, "sleeper_spacing": 0.6}
    return Scene.check(tables).with_(**changes)


def beam_of(scene: Scene) -> TrackBeam:
    found = of_scene(scene)
    assert found is not None
    return found


def struck(scene: Scene, folder: Path) -> tuple[Receptance, float]:
    """What the web has under the hammer, and its receptance at rest [m/N].

    The integral of the displacement over that of the force, F T / 2, is the receptance at 0 Hz.
    """
    run(scene, folder, quiet=True)
    samples, hammer = read(folder), scene.loads[0].hammer
    assert samples is not None and hammer is not None
    way = samples.motion[WEB][:, 2].sum() * samples.interval
    still = way / (hammer.force[2] * hammer.duration / 2)
    return receptance(Record(folder), *AUDIBLE), still


def decibels(found: np.ndarray, exact: np.ndarray) -> np.ndarray:
    return 20 * np.log10(np.abs(found / exact))


def off(found: Receptance, exact: np.ndarray, low: float, high: float) -> float:
    """Largest difference of the web under the hammer within a range of frequencies [dB]."""
    value = found.value[found.names.index(WEB)]
    inside = (found.frequency >= low) & (found.frequency <= high)
    return float(np.abs(decibels(value, exact))[inside].max())
