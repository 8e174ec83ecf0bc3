"""Signals of one bearing are those of version 0.2 bit for bit, so that its bags and figures can be made again.

The checksums (CRC-32) were computed by that version, at 10 kHz.
"""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from amb_core.excitation import Playback, excitation_from_definition, excitation_from_request, generate
from amb_core.excitation.playback import RESOLUTION, Checksum, checksum_of, same_samples

AXES = ("both", "in_turn", "x", "y")
TWO_SECONDS: list[tuple[str, dict[str, Any], tuple[int, int, int, int]]] = [
    ("sweep", {}, (1117252931, 3964850502, 1891555307, 3429782654)),
    ("sweep", {"spacing": "logarithmic", "frequency_end": 1000.0}, (461939479, 2202965232, 4052653001, 339828232)),
    ("square", {}, (3064676985, 2761580143, 3903348888, 2688830519)),
    ("multisine", {}, (3248727705, 4255089268, 3092538445, 2276502530)),
    ("multisine", {"phasing": "schroeder"}, (2970704373, 74250020, 2135741474, 807068417)),
    ("multisine", {"phasing": "optimised", "interleaved": True}, (2499176424, 3176241845, 490312062, 2005440576)),
    ("multisine", {"interleaved": True}, (3361747627, 2054351421, 279396169, 645948212)),
    ("multisine", {"odd": True, "periods": 2, "seed": 3}, (3107281763, 306450731, 3002710683, 4119564078)),
    ("prbs", {}, (3967445418, 44764482, 965885295, 732903955)),
    ("prbs", {"frequency": 200.0, "seed": 4}, (1343276650, 598582881, 2151040643, 778169919)),
    ("white_noise", {"frequency_end": 4000.0}, (1018724655, 1149281693, 892229671, 4157716446)),
    (
        "tones",
        {"frequencies": [20.0, 133.0], "amplitudes": [1e-05, 2e-05]},
        (665438195, 3759996371, 3362681339, 293656798),
    ),
]
ODD_NUMBER_OF_STEPS = {
    "square": (1539720957, 1345110341),
    "prbs": (3396071168, 3496764344),
    "multisine": (2762951351, 1202080061),
    "white_noise": (2059117017, 2555858260),
}

last_bits = pytest.mark.skipif(np.lib.NumpyVersion(np.__version__) < "2.0.0", reason="the last bits are NumPy 2's")


@last_bits
@pytest.mark.parametrize(("kind", "values", "checksums"), TWO_SECONDS)
def test_each_kind_has_the_samples_of_the_former_version(
    kind: str, values: dict[str, Any], checksums: tuple[int, ...]
) -> None:
    size = {} if kind == "tones" else {"amplitude": 50e-6}
    for axes, checksum in zip(AXES, checksums, strict=True):
        excitation = excitation_from_request(kind, {**size, "duration": 2.0, "axes": axes, **values})
        assert bits_of(generate(excitation, 10_000.0).samples) == checksum
        assert bits_of(samples_of(Playback(excitation, 10_000.0))) == checksum


@last_bits
@pytest.mark.parametrize("kind", ODD_NUMBER_OF_STEPS)
def test_an_odd_step_goes_to_the_last_axis(kind: str) -> None:
    for axes, checksum in zip(("both", "in_turn"), ODD_NUMBER_OF_STEPS[kind], strict=True):
        excitation = excitation_from_request(kind, {"amplitude": 50e-6, "duration": 1.0001, "axes": axes})
        assert bits_of(samples_of(Playback(excitation, 10_000.0))) == checksum


@last_bits
@pytest.mark.parametrize("axes", ["both", "all", None])
def test_a_recorded_definition_on_both_axes_makes_its_samples(axes: str | None) -> None:
    named = "" if axes is None else f', "axes": "{axes}"'
    recorded = excitation_from_definition("multisine", f'{{"amplitude": 5e-05, "duration": 2.0{named}}}')
    assert bits_of(samples_of(Playback(recorded, 10_000.0))) == TWO_SECONDS[3][2][0]


# -- the checksum that travels with a definition


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


def bits_of(samples: NDArray[np.float64]) -> int:
    return zlib.crc32(samples.astype("<f8").tobytes())


def samples_of(played: Playback) -> NDArray[np.float64]:
    windows, index = [], 0
    while index < played.steps:
        windows.append(played.window(index)[1])
        index += len(windows[-1])
    return np.concatenate(windows)
