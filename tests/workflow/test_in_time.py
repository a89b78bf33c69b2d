# SPDX-License-Identifier: LGPL-3.0-or-later
"""Growth, limit cycles and bands of samples that are known, and of a run."""

import json
import shutil

import numpy as np
import pytest

from workflow.squeal.in_time import bands, cycle, in_time, oscillations, window

INTERVAL = 1e-5
T = np.arange(0.0, 0.02, INTERVAL)
WAVES = {2302.0: 157.0, 410.0: -60.0, 2208.0: 20.0}  # growth rate by frequency


def channels(noise):
    """Three channels of three oscillations, a drift and noise."""
    rng = np.random.default_rng(1)
    a, b, c = (
        np.exp(rate * T) * np.cos(2 * np.pi * f * T + phase)
        for phase, (f, rate) in enumerate(WAVES.items())
    )
    made = {"p": 0.05 * a + b + 30 * T, "q": 0.02 * a + 0.2 * b + 0.03 * c, "r": 0.005 * a}
    return {name: x + noise * rng.standard_normal(len(T)) for name, x in made.items()}


@pytest.mark.parametrize(
    ("noise", "error"), [(0.0, 1e-3), (1e-3, 0.5), (1e-2, 3.0)], ids=["none", "low", "high"]
)
def test_oscillations_are_what_the_samples_were_made_of(noise, error):
    """Growth of the strongest within 1e-3, 0.5 and 3 per second, frequencies within 0.3 Hz."""
    found = oscillations(channels(noise), INTERVAL, 3000.0)
    near = {f: min(found, key=lambda row: abs(row.frequency - f)) for f in (2302.0, 410.0)}
    for f, row in near.items():
        assert row.frequency == pytest.approx(f, abs=0.3)
        assert row.growth_rate == pytest.approx(WAVES[f], abs=error)
    assert near[2302.0].grows and not near[410.0].grows
    assert near[2302.0].channel == "r" and near[410.0].channel == "p"
    end = 0.005 * np.exp(157.0 * T[-1])
    assert near[2302.0].amplitude == pytest.approx(end, rel=0.1)


def test_noise_alone_does_not_grow():
    """White noise: nothing that holds more than a tenth of it grows beyond doubt."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        noise = {name: rng.standard_normal(len(T)) for name in "ab"}
        found = oscillations(noise, INTERVAL, 3000.0)
        assert not [row for row in found if row.grows and row.share > 0.1]


def test_a_limit_cycle_is_told_from_growth():
    """What grows at 400 per second to 2 and stays: since when, how large, its overtones."""
    size = 2 / np.sqrt(1 + np.exp(-800 * (T - 0.006)))  # a Van der Pol oscillator's envelope
    x = size * np.cos(2 * np.pi * 2302 * T) + 0.1 * size**2 * np.cos(2 * np.pi * 4604 * T)
    seen = {"rim": x + 0.001 * np.random.default_rng(1).standard_normal(len(T))}
    (row, *_) = sorted(oscillations(seen, INTERVAL, 3000.0), key=lambda row: -row.share)
    found = cycle(T, seen, row)
    assert found is not None
    assert found.amplitude == pytest.approx(2.0, rel=0.02)
    assert 0.006 < found.since < 0.011
    assert found.harmonics[0] == pytest.approx(0.2, rel=0.05) and found.harmonics[1] < 0.01
    growing = {"rim": 1e-3 * np.exp(300 * T) * np.cos(2 * np.pi * 2302 * T)}
    (row, *_) = oscillations(growing, INTERVAL, 3000.0)
    assert cycle(T, growing, row) is None


def test_mean_squares_of_bands():
    """A sine has half of its square in the third octave where it is; the sum is the whole."""
    x = {"rim": 3.0 * np.cos(2 * np.pi * 1000 * T)}
    found = {row["band"]: row["mean_square"] for row in bands(x, INTERVAL)}
    assert found[1000.0] == pytest.approx(4.5, rel=0.02)
    assert sum(found.values()) == pytest.approx(4.5, rel=0.02)


@pytest.mark.slow
def test_mode_coupling_by_its_samples_row_38(run_scene, tmp_path, command):
    """The command finds 2307.0 Hz and 344.9 per second in the contact force, within 0.1 %."""
    folder = run_scene("mode-coupling", **{"output.sample_interval": 2e-5})
    seen = window(folder, 3e-3, None, 5000.0)
    found = in_time(seen)
    (row, *_) = sorted(found["oscillations"], key=lambda row: -row["share"])
    assert row["frequency"] == pytest.approx(2307.0, rel=1e-3)
    assert row["growth_rate"] == pytest.approx(344.9, rel=2e-3)
    assert row["grows"] and row["limit_cycle"] is None
    copied = tmp_path / "run"
    shutil.copytree(folder, copied)
    done = command("growth", copied, "--from", 3e-3, "--to", 5000, "--json")
    told = json.loads(done.stdout)
    assert told["oscillations"] == found["oscillations"]
    assert (copied / "figures" / "growth.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("scene", "keys", "words", "message"),
    [
        ("bar-wave", {}, [], "no samples; expected a run with output.sample_interval"),
        ("bar-wave", {"output.sample_interval": 1e-6}, ["--to", "1e7"], "--to 1e+07: expected a"),
        ("bar-wave", {"output.sample_interval": 1e-6}, ["--from", "1"], "0 samples in the window"),
    ],
)
def test_bad_input_is_told(run_scene, command, scene, keys, words, message):
    """Without samples, above half the rate, a window without any: one line, code 2."""
    done = command("growth", run_scene(scene, **keys), *words, check=False)
    assert done.returncode == 2
    assert message in done.stderr.replace("\n", " ")
