"""Excitations played window by window: the samples of `generate` bit for bit, in little memory, definitions checked."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from amb_core.excitation import (
    KINDS,
    Playback,
    definition_of,
    excitation_from_definition,
    excitation_from_request,
    generate,
    instantaneous_frequency,
    playback,
)
from amb_core.excitation.signal import Excitation
from amb_core.ground.errors import ExcitationError

SETTINGS: dict[str, list[dict[str, Any]]] = {
    "sweep": [{"spacing": "linear"}, {"spacing": "logarithmic"}, {"frequency_start": 300.0, "frequency_end": 20.0}],
    "square": [{"frequency": 7.3}],
    "multisine": [{}, {"phasing": "schroeder"}, {"interleaved": True}],
    "prbs": [{}, {"frequency": 3.3}, {"frequency": 1_000.0}],
    "white_noise": [{}],
    "tones": [{"count": 3}, {"count": 20}],
}


def make(kind: str, duration: float, **values: Any) -> Excitation:
    if kind == "tones":
        count = values.pop("count", 3)
        values |= {"frequencies": [20.0 + 3.7 * n for n in range(count)], "amplitudes": [1e-6] * count}
    else:
        values["amplitude"] = 5e-5
    return excitation_from_request(kind, {"duration": duration, **values})


def samples_of(played: Playback, indices: NDArray[np.int_]) -> NDArray[np.float64]:
    """Single samples in this order, as a loop takes them."""
    samples = []
    for index in indices.tolist():
        first, window = played.window(index)
        samples.append(window[index - first])
    return np.array(samples)


@settings(max_examples=60, deadline=None)
@given(
    case=st.sampled_from([(kind, values) for kind, cases in SETTINGS.items() for values in cases]),
    axes=st.sampled_from(["x", "y", "both", "in_turn"]),
    duration=st.floats(0.25, 2.0),
    rate=st.floats(2_000.0, 12_000.0),
    in_files=st.booleans(),
)
def test_a_playback_has_the_samples_of_generate_bit_for_bit(
    case: tuple[str, dict[str, Any]], axes: str, duration: float, rate: float, in_files: bool
) -> None:
    excitation = make(case[0], duration, axes=axes, **case[1])
    expected = generate(excitation, rate).samples
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(playback, "HIGHEST_IN_MEMORY", 0 if in_files else 10**9)
        played = Playback(excitation, rate)
    assert played.steps == len(expected)
    assert playback.same_samples(played.checksum, playback.checksum_of(expected))
    indices = np.random.default_rng(0).integers(0, len(expected), 50)
    assert samples_of(played, indices).tobytes() == expected[indices].tobytes()


@settings(max_examples=60, deadline=None)
@given(
    case=st.sampled_from([(kind, values) for kind, cases in SETTINGS.items() for values in cases]),
    block=st.integers(1, 3_000),
    axis=st.sampled_from([0, 1]),
)
def test_parts_of_a_signal_are_those_of_the_whole_whatever_their_size(
    case: tuple[str, dict[str, Any]], block: int, axis: int
) -> None:
    steps = 5_000
    sampler = make(case[0], 0.5, **case[1]).sampler(steps, 10_000.0, axis)
    parts = [sampler(first, min(first + block, steps)) for first in range(0, steps, block)]
    assert np.concatenate(parts).tobytes() == sampler(0, steps).tobytes()


def test_windows_cover_each_step_once() -> None:
    played = Playback(make("sweep", 0.7777, axes="in_turn"), 10_000.0)
    index = 0
    while index < played.steps:
        first, window = played.window(index)
        assert first == index
        assert 1 <= len(window) <= playback.WINDOW
        index += len(window)
    assert index == played.steps


def test_no_sample_is_there_before_the_first_and_after_the_last() -> None:
    played = Playback(make("square", 0.1), 10_000.0)
    for index in (-1, 1_000):
        with pytest.raises(IndexError, match=f"sample {index} asked for; there are 1000"):
            played.window(index)


def test_a_long_signal_leaves_no_file_behind(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(playback, "HIGHEST_IN_MEMORY", 100)
    monkeypatch.setattr(playback.tempfile, "tempdir", str(tmp_path))
    played = Playback(make("multisine", 0.5), 10_000.0)
    assert played.steps == 5_000
    assert not list(tmp_path.iterdir())


def test_a_temporary_file_that_cannot_be_written_is_an_error_that_names_its_folder(
    tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(playback, "HIGHEST_IN_MEMORY", 100)
    monkeypatch.setattr(playback.tempfile, "tempdir", str(tmp_path / "missing"))
    with pytest.raises(ExcitationError, match=r"cannot be kept in a temporary file in .*missing: No such file"):
        Playback(make("multisine", 0.5), 10_000.0)


def test_making_samples_can_be_called_off() -> None:
    with pytest.raises(ExcitationError, match="cancelled"):
        Playback(make("sweep", 600.0), 10_000.0, cancelled=lambda: True)


MEMORY = """
import resource, sys
from amb_core.excitation import Playback, excitation_from_request
import scipy.signal
def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
before = peak()
played = Playback(excitation_from_request(sys.argv[1], {"amplitude": 1e-5, "duration": 600.0}), 10_000.0)
print(played.steps, peak() - before)
"""


@pytest.mark.parametrize("kind", ["sweep", "square", "prbs"])
def test_600_s_are_made_and_checked_in_little_memory(kind: str) -> None:
    result = subprocess.run([sys.executable, "-c", MEMORY, kind], capture_output=True, text=True, check=True)
    steps, growth = result.stdout.split()
    assert int(steps) == 6_000_000
    assert float(growth) < 20.0  # MB; all samples are 96 MB


@pytest.mark.parametrize("kind", KINDS)
def test_a_definition_makes_the_same_excitation(kind: str) -> None:
    excitation = make(kind, 1.0)
    assert excitation_from_definition(kind, definition_of(excitation)) == excitation


@pytest.mark.parametrize(
    ("kind", "definition", "reason"),
    [
        ("triangle", "{}", "unknown kind of excitation 'triangle'; allowed: sweep"),
        ("sweep", "", "sweep: its description is not a JSON object of settings: Expecting value"),
        ("sweep", "[1]", "must be a JSON object of settings, not '\\[1\\]'"),
        ("sweep", "[" * 100_000, "nested too deeply"),
        ("sweep", '{"a":' * 100_000, "nested too deeply"),
        ("sweep", "{}", "duration"),
        ("sweep", '{"amplitude": NaN, "duration": 1.0}', "'amplitude' = nan is not allowed"),
        ("sweep", '{"amplitude": 1e300, "duration": 1.0}', "'amplitude' = 1e\\+300 is not allowed; allowed: 1e-09"),
        ("sweep", '{"amplitude": 1e-5, "duration": 1e9}', "'duration' = 1000000000.0 is not allowed"),
        ("sweep", '{"amplitude": 1e-5, "duration": 1.0, "color": 1}', "unknown parameter 'color'"),
        ("prbs", '{"amplitude": 1e-5, "duration": 1.0, "seed": -1}', "'seed' = -1 is not allowed"),
        (
            "tones",
            json.dumps({"duration": 1.0, "frequencies": [5.0] * 1_001, "amplitudes": [1e-9] * 1_001}),
            "1001 frequencies; allowed: 1000 at most",
        ),
        (
            "tones",
            '{"duration": 1.0, "frequencies": [5.0], "amplitudes": [1e-6], "phases": [Infinity]}',
            "finite",
        ),
    ],
)
def test_a_definition_that_is_none_is_refused_with_the_reason(kind: str, definition: str, reason: str) -> None:
    with pytest.raises(ExcitationError, match=reason) as problem:
        excitation_from_definition(kind, definition)
    assert "\n" not in str(problem.value)


@pytest.mark.parametrize("kind", KINDS)
def test_the_frequency_is_that_of_the_signal(kind: str) -> None:
    excitation = make(kind, 1.0, axes="in_turn", **({"count": 1} if kind == "tones" else {}))
    expected = generate(excitation, 10_000.0).frequency
    frequency = instantaneous_frequency(excitation, 10_000.0)
    assert (frequency is None) == (expected is None) == (kind not in ("sweep", "tones"))
    if expected is not None and frequency is not None:
        assert frequency.tobytes() == expected.tobytes()
