"""Signals of one bearing are those of version 0.2, so that its bags and figures can be made again on any processor.

The checksums are those of its samples at 10 kHz. They do not depend on how a processor rounds; that both ways to make
the samples agree bit for bit on one processor is tested beside.
"""

from __future__ import annotations

import os
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from numpy._core._multiarray_umath import __cpu_dispatch__
from numpy.typing import NDArray

from amb_core.excitation import Playback, excitation_from_definition, excitation_from_request, generate
from amb_core.excitation.playback import RESOLUTION, Checksum, checksum_of, same_samples

AXES = ("both", "in_turn", "x", "y")
TWO_SECONDS: list[tuple[str, dict[str, Any], tuple[int, int, int, int]]] = [
    ("sweep", {}, (497033003, 1108442968, 676952932, 4115047367)),
    ("sweep", {"spacing": "logarithmic", "frequency_end": 1000.0}, (493202305, 446578389, 4116992874, 671176727)),
    ("square", {}, (4240430798, 22731751, 4217699047, 22731751)),
    ("multisine", {}, (4276391516, 4166715147, 4169603330, 106788186)),
    ("multisine", {"phasing": "schroeder"}, (4064572234, 633741600, 205570617, 3859001617)),
    ("multisine", {"phasing": "optimised", "interleaved": True}, (59692653, 4049947811, 352125990, 4002533960)),
    ("multisine", {"phasing": "optimised", "odd": True}, (3723089081, 319130923, 97493977, 3625595104)),
    ("multisine", {"phasing": "schroeder", "interleaved": True}, (3844478525, 4220747651, 538834851, 3305643673)),
    ("multisine", {"interleaved": True}, (127378260, 4260186556, 4177541806, 244803750)),
    ("multisine", {"odd": True, "periods": 2, "seed": 3}, (4022636681, 4138556525, 4251098802, 4066505175)),
    ("prbs", {}, (4041823521, 478719141, 4202479315, 4134311502)),
    ("prbs", {"frequency": 200.0, "seed": 4}, (1915279487, 4258539149, 2732012783, 3478234000)),
    ("white_noise", {"frequency_end": 4000.0}, (4195070743, 2955210624, 873035677, 3322035066)),
    (
        "tones",
        {"frequencies": [20.0, 133.0], "amplitudes": [1e-05, 2e-05]},
        (4289376282, 3739209983, 282061059, 4007315223),
    ),
]
ODD_NUMBER_OF_STEPS = {
    "square": (20489687, 4289056014),
    "prbs": (3721117523, 3714373294),
    "multisine": (243227865, 4072104583),
    "white_noise": (4156338016, 3709721461),
}


@pytest.mark.parametrize(("kind", "values", "checksums"), TWO_SECONDS)
def test_each_kind_has_the_samples_of_the_former_version(
    kind: str, values: dict[str, Any], checksums: tuple[int, ...]
) -> None:
    size = {} if kind == "tones" else {"amplitude": 50e-6}
    for axes, checksum in zip(AXES, checksums, strict=True):
        excitation = excitation_from_request(kind, {**size, "duration": 2.0, "axes": axes, **values})
        made, played = generate(excitation, 10_000.0).samples, Playback(excitation, 10_000.0)
        assert same_samples(checksum_of(made), checksum)
        assert same_samples(played.checksum, checksum)
        assert np.array_equal(samples_of(played), made)


@pytest.mark.parametrize("kind", ODD_NUMBER_OF_STEPS)
def test_an_odd_step_goes_to_the_last_axis(kind: str) -> None:
    for axes, checksum in zip(("both", "in_turn"), ODD_NUMBER_OF_STEPS[kind], strict=True):
        excitation = excitation_from_request(kind, {"amplitude": 50e-6, "duration": 1.0001, "axes": axes})
        assert same_samples(checksum_of(samples_of(Playback(excitation, 10_000.0))), checksum)


@pytest.mark.parametrize("axes", ["both", "all", None])
def test_a_recorded_definition_on_both_axes_makes_its_samples(axes: str | None) -> None:
    named = "" if axes is None else f', "axes": "{axes}"'
    recorded = excitation_from_definition("multisine", f'{{"amplitude": 5e-05, "duration": 2.0{named}}}')
    assert same_samples(checksum_of(samples_of(Playback(recorded, 10_000.0))), TWO_SECONDS[3][2][0])


# -- the checksum that travels with a definition


LONG_SWEEP = {"duration": 600.0, "frequency_start": 10.0, "frequency_end": 4900.0}


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        pytest.param("multisine", {"duration": 2.0, **TWO_SECONDS[5][1]}, id="300 clippings in a search of phases"),
        pytest.param("sweep", {**LONG_SWEEP, "spacing": "logarithmic"}, id="a million cycles of a logarithmic sweep"),
        pytest.param("sweep", {**LONG_SWEEP, "spacing": "linear"}, id="a million cycles of a linear sweep"),
    ],
)
def test_an_older_processor_makes_the_same_samples(kind: str, values: dict[str, Any]) -> None:
    """Where a difference in the last bit, such as that of another sine or logarithm, would grow."""
    request = {"amplitude": 1e-3, "axes": "in_turn", **values}
    program = f"""
from amb_core.excitation import Playback, excitation_from_request
print(Playback(excitation_from_request({kind!r}, {request!r}), 10_000.0).checksum)
"""
    older = os.environ | {"NPY_DISABLE_CPU_FEATURES": " ".join(__cpu_dispatch__)}
    ended = subprocess.run([sys.executable, "-W", "ignore", "-c", program], env=older, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
    here = Playback(excitation_from_request(kind, request), 10_000.0).checksum
    assert same_samples(int(ended.stdout), here)


@pytest.mark.parametrize(("kind", "values", "_checksums"), TWO_SECONDS)
def test_samples_rounded_by_another_processor_have_the_same_checksum(
    kind: str, values: dict[str, Any], _checksums: Any
) -> None:
    size = {} if kind == "tones" else {"amplitude": 1e-3}
    excitation = excitation_from_request(kind, {**size, "duration": 2.0, **values})
    checksum, samples = Playback(excitation, 10_000.0).checksum, generate(excitation, 10_000.0).samples
    rng = np.random.default_rng(0)
    for towards in (np.inf, -np.inf, rng.choice([-np.inf, np.inf], samples.shape)):
        assert same_samples(checksum, checksum_of(np.nextafter(samples, towards)))


def test_rounding_of_ten_minutes_moves_a_checksum_by_one_unit_at_most() -> None:
    """Of a signal at its largest amplitude on four axes, with errors of ten units in the last place."""
    rng = np.random.default_rng(0)
    here, there = Checksum(), Checksum()
    for _ in range(240):
        samples = rng.uniform(-1e-3, 1e-3, (25_000, 4))
        here.add(samples)
        there.add(samples * (1.0 + 1e-15 * rng.uniform(-1.0, 1.0, samples.shape)))
    assert same_samples(here.value, there.value)


@pytest.mark.parametrize(("kind", "values", "_checksums"), TWO_SECONDS)
def test_other_samples_have_another_checksum(kind: str, values: dict[str, Any], _checksums: Any) -> None:
    size = {} if kind == "tones" else {"amplitude": 1e-6}
    excitation = excitation_from_request(kind, {**size, "duration": 2.0, **values})
    samples = generate(excitation, 10_000.0).samples
    checksum, rng = checksum_of(samples), np.random.default_rng(0)
    for other in (1.001 * samples, samples[::-1], samples[:, ::-1] if samples[:, 0].any() else -samples, 0.0 * samples):
        if not np.array_equal(other, samples):
            assert not same_samples(checksum, checksum_of(other))
    one = samples.copy()
    one[rng.integers(len(one)), 0] += 20.0 * RESOLUTION
    assert not same_samples(checksum, checksum_of(one))


@pytest.mark.parametrize("seed", range(1, 5))
def test_another_seed_has_another_checksum(seed: int) -> None:
    def checksum(of: int) -> int:
        return Playback(excitation_from_request("prbs", {"amplitude": 1e-9, "duration": 1.0, "seed": of}), 1e4).checksum

    assert not same_samples(checksum(0), checksum(seed))


def test_checksums_are_compared_across_the_end_of_their_range() -> None:
    assert same_samples(0, 2**32 - 1)
    assert same_samples(2**32 - 1, 0)
    assert not same_samples(1, 2**32 - 1)


def samples_of(played: Playback) -> NDArray[np.float64]:
    windows, index = [], 0
    while index < played.steps:
        windows.append(played.window(index)[1])
        index += len(windows[-1])
    return np.concatenate(windows)
