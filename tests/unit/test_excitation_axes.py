"""Axes of an excitation on machines of any number of axes: names, bearings, rigid modes, orthogonal experiments."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from amb_core.excitation import (
    KINDS,
    Excitation,
    Playback,
    excitation_from_request,
    experiments_of,
    generate,
    instantaneous_frequency,
    steps_of,
)
from amb_core.excitation.signal import excited_spans
from amb_core.ground.errors import ExcitationError
from amb_core.loop.machine import DIRECTIONS, Machine, MachineAxis, MachineBearing
from amb_core.recording.messages.excitation import fill_excitation, frequency_from_message

RATE = 10_000.0


def axis(name: str, bearing: str, position: float, direction: tuple[float, float, float]) -> MachineAxis:
    return MachineAxis(name, bearing, position, position, direction, 2.0, 3.0)


def machine(positions: dict[str, float], thrust: bool = False) -> Machine:
    """Radial bearings at axial positions (m), and a thrust bearing."""
    axes = [axis(f"{d}_{name}", name, z, DIRECTIONS[d]) for name, z in positions.items() for d in "xy"]
    if thrust:
        axes.append(axis("z", "thrust", 0.0, DIRECTIONS["z"]))
    bearings = [*positions, *(["thrust"] if thrust else [])]
    return Machine("test", "simulator", RATE, tuple(axes), tuple(MachineBearing(name, 2e-4) for name in bearings))


def row_of(count: int) -> Machine:
    axes = tuple(axis(f"axis_{number}", "a", 0.0, DIRECTIONS["x"]) for number in range(count))
    return Machine("row", "simulator", RATE, axes, (MachineBearing("a", 2e-4),))


RIG = machine({"a": -0.1, "b": 0.15})
FIVE = machine({"a": -0.1, "b": 0.15}, thrust=True)


def make(kind: str = "multisine", **values: Any) -> Excitation:
    size: dict[str, Any] = {"amplitude": 50e-6}
    if kind == "tones":
        size = {"frequencies": [20.0, 50.0], "amplitudes": [10e-6, 40e-6]}
    return excitation_from_request(kind, {"duration": 1.0, **size, **values})


def samples(kind: str = "multisine", of: Machine | None = RIG, **values: Any) -> NDArray[np.float64]:
    return generate(make(kind, **values), RATE, of).samples


def excited(signal: NDArray[np.float64]) -> list[int]:
    return np.flatnonzero(signal.any(axis=0)).tolist()


@pytest.mark.parametrize(
    ("axes", "numbers"),
    [
        ("x_a", [0]),
        ("x_a,y_b", [0, 3]),
        (" y_b , x_a ", [0, 3]),
        ("bearing_b", [2, 3]),
        ("bearing_a,x_b", [0, 1, 2]),
        ("bearing_thrust", [4]),
        ("z", [4]),
        ("translate_x", [0, 2]),
        ("tilt_y", [1, 3]),
        ("translate_z", [4]),
        ("all", [0, 1, 2, 3, 4]),
        ("", [0, 1, 2, 3, 4]),
        ("in_turn", [0, 1, 2, 3, 4]),
    ],
)
def test_the_axes_that_are_named_are_excited_and_no_other(axes: str, numbers: list[int]) -> None:
    assert excited(samples("white_noise", FIVE, axes=axes)) == numbers


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("axes", ["all", "in_turn", "tilt_x", "x_a,y_b"])
def test_a_playback_on_four_axes_has_the_samples_of_generate(kind: str, axes: str) -> None:
    excitation = make(kind, axes=axes, duration=1.0003)
    expected = generate(excitation, RATE, RIG).samples
    played = Playback(excitation, RATE, RIG)
    assert expected.shape == (10_003, 4)
    assert played.steps == steps_of(excitation, RATE, RIG) == 10_003
    for index in (0, 2_499, 2_500, 7_500, 10_002):
        first, window = played.window(index)
        assert window.tobytes() == expected[first : first + len(window)].tobytes()


def test_in_turn_each_axis_has_an_equal_share_and_the_last_one_the_remaining_samples() -> None:
    signal = generate(make("sweep", duration=1.0003), RATE, RIG)
    spans = [(0, 2_500), (2_500, 5_000), (5_000, 7_500), (7_500, 10_003)]
    assert experiments_of(signal.parameters, RATE, RIG) == spans
    assert excited_spans(signal) == [(number, *span) for number, span in enumerate(spans)]
    for number, (first, stop) in enumerate(spans):
        assert excited(signal.samples[first:stop]) == [number]
    frequency = instantaneous_frequency(signal.parameters, RATE, RIG)
    assert frequency is not None
    assert frequency[[0, 2_500, 5_000, 7_500]] == pytest.approx(11.0)


def test_the_frequency_of_a_recorded_definition_is_that_on_the_axes_of_the_machine() -> None:
    sweep = make("sweep")
    message = fill_excitation(SimpleNamespace(axes=[]), sweep, 1, 0, RATE, RIG)
    recorded = frequency_from_message(message, RIG)
    assert recorded.tobytes() == instantaneous_frequency(sweep, RATE, RIG).tobytes()  # type: ignore[union-attr]
    assert recorded[2_500] == pytest.approx(11.0)
    assert frequency_from_message(message)[2_500] == pytest.approx(205.5, rel=1e-3)  # half way on the first of two axes
    assert message.checksum == Playback(sweep, RATE, RIG).checksum


def test_signals_on_all_axes_are_one_experiment() -> None:
    assert experiments_of(make("prbs"), RATE, RIG) == [(0, 10_000)]


def test_a_translation_is_equal_on_all_axes_of_its_direction() -> None:
    signal = samples(axes="translate_y")
    assert signal[:, 1].tobytes() == signal[:, 3].tobytes()
    assert np.max(np.abs(signal)) == pytest.approx(50e-6)


def test_a_tilt_is_proportional_to_the_positions_of_the_sensors_and_its_largest_reference_is_the_amplitude() -> None:
    signal = samples(axes="tilt_x")
    np.testing.assert_allclose(signal[:, 0], signal[:, 2] * (-0.1 / 0.15), atol=1e-18)
    assert np.max(np.abs(signal[:, 2])) == pytest.approx(50e-6)


def test_a_mode_moves_axes_that_point_elsewhere_by_their_component_along_it() -> None:
    half = math.sqrt(0.5)
    turned = Machine(
        "turned",
        "bridge",
        RATE,
        (axis("v", "a", 0.0, (half, half, 0.0)), axis("w", "a", 0.0, (-half, half, 0.0))),
        (MachineBearing("a", 2e-4),),
    )
    signal = samples("square", turned, axes="translate_x")
    assert signal[0] == pytest.approx([50e-6, -50e-6])


@pytest.mark.parametrize(
    ("positions", "reason"),
    [
        ({"a": math.nan, "b": math.nan}, "axial positions of the sensors x_a, x_b are unknown"),
        ({"a": 0.1, "b": 0.1}, r"the sensors along x \(x_a, x_b\) lie in one plane"),
        ({"a": 0.0}, r"the sensors along x \(x_a\) lie in one plane"),
    ],
)
def test_a_tilt_without_two_known_planes_is_refused(positions: dict[str, float], reason: str) -> None:
    with pytest.raises(ExcitationError, match=f"multisine: axes = 'tilt_x' is not allowed: {reason}"):
        samples(of=machine(positions), axes="tilt_x")


def test_a_translation_along_the_shaft_needs_a_thrust_bearing() -> None:
    with pytest.raises(ExcitationError, match="no axis of this machine acts along z"):
        samples(axes="translate_z")


@pytest.mark.parametrize(
    ("of", "axes", "message"),
    [
        (
            None,
            "z",
            "sweep: axes = 'z' is not allowed; allowed: x, y, bearing_a .*, translate_x, translate_y, all, both,",
        ),
        (None, "x_a", "axes = 'x_a' is not allowed; .*allowed: x, y"),
        (RIG, "x", "axes = 'x' is not allowed; .*allowed: x_a, y_a, x_b, y_b, bearing_a, bearing_b"),
        (RIG, "both", "axes = 'both' is not allowed; did you mean 'all'[?]"),
        (RIG, "tilt_z", "did you mean 'tilt_y'[?]|did you mean 'tilt_x'[?]"),
        (RIG, "beering_b", "did you mean 'bearing_b'[?]"),
        (RIG, "x_a,yb", "axes = 'yb' in 'x_a,yb' is not allowed; did you mean 'y_b'[?]"),
        (RIG, "x_a,x_a", "it names an axis twice"),
        (RIG, "bearing_a,x_a", "it names an axis twice"),
        (RIG, "x_a,", "axes = '' in 'x_a,' is not allowed"),
        (RIG, "orthogonal", "sweep: axes = 'orthogonal' is not allowed; only multisines"),
        (RIG, "a\nb" * 1_000, r"axes = 'a\\nba"),
    ],
)
def test_axes_that_the_machine_lacks_are_refused_in_one_line(of: Machine | None, axes: str, message: str) -> None:
    with pytest.raises(ExcitationError, match=message) as refusal:
        generate(make("sweep", axes=axes), RATE, of)
    assert "\n" not in str(refusal.value)
    assert len(str(refusal.value)) < 400


@pytest.mark.parametrize("kind", ["multisine", "prbs", "white_noise"])
def test_signals_of_different_axes_are_independent(kind: str) -> None:
    correlation = np.corrcoef(samples(kind, FIVE, duration=10.0).T)
    # 390 lines and more, 5000 bits: the standard deviation of a correlation is 0.05 at most.
    assert np.max(np.abs(correlation - np.eye(5))) < 0.2


def test_the_shares_of_a_pseudo_random_sequence_have_no_pattern_in_common() -> None:
    bits = samples("prbs", FIVE, duration=1.0, frequency=1_000.0)[::10] > 0.0
    register = (5 * len(bits)).bit_length()
    patterns = [tuple(of_axis[n : n + register]) for of_axis in bits.T for n in range(len(bits) - register)]
    assert len(set(patterns)) == len(patterns)


@pytest.mark.parametrize("phasing", ["schroeder", "optimised", "random"])
def test_no_two_axes_carry_the_same_multisine(phasing: str) -> None:
    signal = samples(phasing=phasing, of=FIVE)
    assert all(not np.allclose(signal[:, i], signal[:, j]) for i in range(5) for j in range(i))


def test_interleaved_lines_go_to_the_axes_in_turn() -> None:
    spectra = np.abs(np.fft.rfft(samples(interleaved=True), axis=0))
    for number, spectrum in enumerate(spectra.T):
        assert np.flatnonzero(spectrum > 1e-6 * spectrum.max()).tolist() == list(range(11 + number, 401, 4))


@pytest.mark.parametrize("axes", ["orthogonal", "tilt_x"])
def test_interleaved_lines_need_an_axis_each(axes: str) -> None:
    with pytest.raises(ExcitationError, match=f"interleaved with axes = '{axes}' is not allowed"):
        make(axes=axes, interleaved=True)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 6])
@pytest.mark.parametrize("phasing", ["random", "schroeder", "optimised"])
def test_orthogonal_experiments_have_an_orthogonal_matrix_of_amplitudes_at_every_line(count: int, phasing: str) -> None:
    request = make(axes="orthogonal", duration=0.4 * count, periods=2, phasing=phasing, seed=3)
    signal = generate(request, RATE, row_of(count))
    spans = experiments_of(request, RATE, row_of(count))
    assert spans == [(4_000 * number, 4_000 * (number + 1)) for number in range(count)]
    for first, stop in spans:  # whole periods of each experiment
        assert signal.samples[first : first + 2_000].tobytes() == signal.samples[first + 2_000 : stop].tobytes()
    spectra = np.stack([np.fft.rfft(signal.samples[first : first + 2_000], axis=0) for first, _ in spans], axis=2)
    excited_lines = slice(3, 81)  # of 5 Hz from 11 to 400 Hz
    amplitudes = spectra[excited_lines]
    products = amplitudes @ amplitudes.conj().transpose(0, 2, 1)
    level = products[0, 0, 0].real
    np.testing.assert_allclose(products, np.broadcast_to(level * np.eye(count), products.shape), atol=1e-11 * level)
    assert np.max(np.abs(np.delete(spectra, np.r_[excited_lines], axis=0))) < 1e-9 * math.sqrt(level)
    assert np.max(np.abs(signal.samples)) == pytest.approx(50e-6, rel=1e-12)


def test_orthogonal_experiments_of_four_axes_change_signs_only() -> None:
    experiments = samples(axes="orthogonal").reshape(4, 2_500, 4)
    for later in experiments[1:]:
        assert np.abs(later).tobytes() == np.abs(experiments[0]).tobytes()


def test_experiments_that_would_not_be_equally_long_are_refused() -> None:
    with pytest.raises(
        ExcitationError, match=r"10000 samples cannot be divided into 3 equal experiments.* 9999 or 10002"
    ):
        samples(of=row_of(3), axes="orthogonal")


def test_a_long_orthogonal_signal_is_played_from_files(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("amb_core.excitation.playback.HIGHEST_IN_MEMORY", 0)
    excitation = make(axes="orthogonal", duration=0.3)
    played = Playback(excitation, RATE, row_of(3))
    expected = generate(excitation, RATE, row_of(3)).samples
    first, window = played.window(2_500)
    assert window.tobytes() == expected[first : first + len(window)].tobytes()
