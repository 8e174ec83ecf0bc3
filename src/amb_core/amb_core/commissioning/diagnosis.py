"""What is wrong with a rig: from rest by way of small currents on its backup bearing to the levitated rotor.

Nothing is levitated before what can be known at rest is known, and the currents until then are so small that the rotor
stays where it lies, whatever is wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from scipy.optimize import linear_sum_assignment

from amb_core.commissioning.bench import Bench, LostSamplesError
from amb_core.commissioning.dynamics import AxisDynamics, axis_dynamics
from amb_core.commissioning.expected import Expected
from amb_core.commissioning.finding import FaultName, Finding
from amb_core.commissioning.sensors_at_rest import (
    hand_findings,
    noise_findings,
    place_findings,
    resolution_findings,
    stiff_sensors,
)
from amb_core.commissioning.tones import ToneResponse, tone_set, response_to
from amb_core.errors import TargetError
from amb_core.loop.records import LoopRecord
from amb_core.units import UM

Hand = Callable[[Bench], Mapping[str, Mapping[str, NDArray[np.float64]]]]
"""Has the rotor pushed by hand in every bearing, see `hand_findings`; returns the measured positions."""

UNCLEAR = ("sensor noise", "sensor hum", "sensor coarse")
"""Nothing small can be measured with such a sensor."""
REST, SETTLE, WINDOW = 0.3, 0.15, 0.5  # s
LOW, HIGH, TONES = 40.0, 1200.0, 9  # Hz, of the tones at rest
SEEN = 3.2  # deviations from which on a response is one
GAIN, REST_GAIN, FORCE = 1.35, 1.5, 2.5  # factors from which on a gain is wrong: levitated, at rest, of all axes at rest
LATE, LATE_AT_REST, SURE = 0.6, 3.0, 3.0  # samples, also of what no first levitation needs, and deviations
UNSURE = 0.15  # relative deviation from which on a gain at rest says nothing
LOWEST = 150.0  # Hz up to which the sign is read
TURN = 0.15  # tangent of the angle from which on axes are turned
LEVITATED_NOISE = 4.0  # times the noise with the currents off
AMPLITUDE = 2e-6  # m, of the tones of a levitated rotor
FAST_LOW, FAST_HIGH, FAST_TONES = 15.0, 900.0, 14
LOUD, SHARE, LESS = 300.0, 0.25, 0.8  # Hz, of the bias current, of the motion in proportion
LOAD = 0.12  # of the bias current


@dataclass
class Diagnosis:
    """What was found, and how far it went.

    Attributes
    ----------
    findings : list of Finding
        The faults.
    unchecked : list of str
        What could not be checked, and why.
    levitated : bool
        Whether the rotor was lifted.
    """

    findings: list[Finding] = field(default_factory=list)
    unchecked: list[str] = field(default_factory=list)
    levitated: bool = False


def diagnose(bench: Bench, expected: Expected | None, hand: Hand | None = None, ramp: float = 0.3) -> Diagnosis:
    """Find the faults of a rig: `before_lift`, and if there are none, `levitated`.

    Parameters
    ----------
    bench, expected, hand
        As in `before_lift`.
    ramp : float
        Duration of the ramp of the first levitation (s).
    """
    result = before_lift(bench, expected, hand)
    if not result.findings:
        result.levitated = True
        result.findings += levitated(bench, expected, ramp, hand is not None)
    return result


def before_lift(bench: Bench, expected: Expected | None, hand: Hand | None = None) -> Diagnosis:
    """Find what can be found while the rotor lies on its backup bearing.

    Parameters
    ----------
    bench : Bench
        The target, off.
    expected : Expected, optional
        Of the model of the machine; without it no gain, angle or delay is compared.
    hand : callable, optional
        Moves the rotor by hand; without it, sensors and coils that are both reversed are not noticed.
    """
    result = Diagnosis()
    rest = at_rest(bench, hand, result)
    if expected is None:
        result.unchecked.append("gains, angles and delays, since the parameter file has no model of the machine")
    if rest is None:
        return result
    dead = [axis for one in result.findings if one.fault == "sensor dead" for axis in one.axes]
    try:
        result.findings += on_the_backup_bearing(bench, expected, hand is not None, result.findings, dead, rest)
    except LostSamplesError:
        raise
    except TargetError as problem:
        bench.off()
        if result.findings:  # of a sensor that shows more than the target takes, for example
            result.unchecked.append(f"coils and amplifiers: {problem}")
        else:
            result.findings.append(Finding("target trips", (), str(problem)))
    return result


def at_rest(bench: Bench, hand: Hand | None, result: Diagnosis) -> LoopRecord | None:
    """Trips, noise, resting place, and the rotor moved by hand; None if nothing can go on."""
    names = bench.machine.axis_names
    if trips := bench.status().trips:
        result.findings.append(Finding("target trips", (), ", ".join(str(trip.reason.name) for trip in trips)))
        if any(trip.reason.name != "SENSOR_RANGE" for trip in trips):
            return None
    record = bench.record(REST)
    result.findings += noise_findings(record.position, names)
    if any(one.fault == "sensor silent" for one in result.findings):
        result.findings = [one for one in result.findings if one.fault != "target trips"]
        return None
    by_hand: list[Finding] = []
    if hand is not None:
        pushed = hand(bench)
        every = np.vstack([record.position, *(values for pushes in pushed.values() for values in pushes.values())])
        result.findings += resolution_findings(every, names)
        if not result.findings:
            by_hand = hand_findings(pushed, bench.machine)
    else:
        result.unchecked.append("sensors and coils that are both reversed, since nobody moved the rotor by hand")
        stuck = [Finding("sensor dead", (names[axis],), "it repeats one value") for axis in stiff_sensors(record.position)]
        by_hand = stuck or place_findings(record.position.mean(axis=0), bench.machine)
    result.findings += by_hand
    return None if any(one.fault in UNCLEAR for one in result.findings) else record


def on_the_backup_bearing(
    bench: Bench,
    expected: Expected | None,
    moved: bool,
    before: list[Finding],
    dead: list[str],
    rest: LoopRecord,
) -> list[Finding]:
    """Sign, connection, angle, gain and delay of every axis, by currents that cannot move the rotor off.

    Parameters
    ----------
    bench : Bench
        The target, off.
    expected : Expected
        Of the model of the machine.
    moved : bool
        Whether the sensors were checked by hand: what is wrong then concerns the coils.
    before : list of Finding
        Those of the sensors.
    dead : list of str
        Axes without a sensor that moves.
    rest : LoopRecord
        With the currents off.
    """
    names = bench.machine.axis_names
    tones = tone_set(LOW, HIGH, TONES, WINDOW, 0.7)
    records = [bench.tones_at_rest(tones, axis, SETTLE, WINDOW) for axis in range(len(names))]
    if found := _of_noise(records[0], rest, bench):
        return found
    every = [response_to(tones, record) for record in records]
    response = matrix_of(every)  # tones, sensors, coils
    deviation = np.array([one.deviation for one in every]).T / np.abs(
        np.array([one.current[:, axis] for axis, one in enumerate(every)])
    ).T[:, np.newaxis, :]
    strength = np.sqrt(np.mean(np.abs(response / np.maximum(deviation, 1e-12)) ** 2, axis=0))  # sensors, coils
    swapped = {name for one in before if one.fault in ("sensors swapped", "sensors turned") for name in one.axes}
    words: dict[str, FaultName] = (
        {"swapped": "coils swapped", "reversed": "coils reversed", "turned": "coils turned", "none": "coil dead"}
        if moved
        else {"swapped": "swapped", "reversed": "reversed", "turned": "turned", "none": "no response"}
    )
    silent = [axis for axis in range(len(names)) if names[axis] not in dead and strength[:, axis].max() < SEEN]
    for axis in silent:
        found.append(Finding(words["none"], (names[axis],), "its current moves nothing"))
    if silent or dead:
        return found
    size = np.log(np.abs(response) + 1e-12).mean(axis=0)
    driven = linear_sum_assignment(-size.T)[1].tolist()  # sensor by coil; contact is stiffer along one axis
    for axis, sensor in enumerate(driven):
        if sensor != axis and not {names[axis], names[sensor]} & swapped:
            text = f"the current of {names[axis]} moves {names[sensor]}"
            found.append(Finding(words["swapped"], tuple(sorted((names[axis], names[sensor]))), text))
    if found or driven != list(range(len(names))):
        return list({one.axes: one for one in found}.values())
    found = _signs(bench, tones.frequency, response, before, words["reversed"])
    if found or expected is None:
        return found
    return _dynamics_at_rest(bench, expected, tones.frequency, response, deviation, before, words["turned"])


def _signs(
    bench: Bench,
    frequency: NDArray[np.float64],
    response: NDArray[np.complex128],
    before: list[Finding],
    word: FaultName,
) -> list[Finding]:
    reversed_sensors = {name for one in before if one.fault == "sensor reversed" for name in one.axes}
    return [
        Finding(word, (name,), "its current moves the rotor the wrong way")
        for axis, name in enumerate(bench.machine.axis_names)
        if _pulls_back(response[:, axis, axis], frequency) != (name in reversed_sensors)
    ]


def _dynamics_at_rest(
    bench: Bench,
    expected: Expected,
    frequency: NDArray[np.float64],
    response: NDArray[np.complex128],
    deviation: NDArray[np.float64],
    before: list[Finding],
    word: FaultName,
) -> list[Finding]:
    inverse, of_model = np.linalg.inv(response), expected.plant.response(frequency)
    model = np.linalg.inv(of_model)
    of_sensors = {name for one in before for name in one.axes}
    found: list[Finding] = []
    for pair, angle in turn_of(inverse @ of_model, bench).items():
        if abs(angle) > TURN and not of_sensors & set(pair):
            text = f"by {np.degrees(np.arctan(angle)):.0f} deg against the sensors"
            found.append(Finding(word, pair, text))
    if found:
        return found
    gains: dict[str, float] = {}
    for axis, name in enumerate(bench.machine.axis_names):
        if name in of_sensors:
            continue
        relative = deviation[:, axis, axis] / np.abs(response[:, axis, axis])
        one = axis_dynamics(
            inverse[:, axis, axis], model[:, axis, axis], frequency, relative, expected.fastest,
            1.0 / bench.rate, contact=True,
        )  # fmt: skip
        found += _of_axis(name, one, LATE_AT_REST)
        if one.gain_error < UNSURE and one.delay < LATE:
            gains[name] = abs(one.gain) / float(expected.resting[axis])
    return found or _gains_at_rest(gains)


def _pulls_back(response: NDArray[np.complex128], frequency: NDArray[np.float64]) -> bool:
    """Whether a positive current moves the rotor down: a passive contact answers with a lag of 0 to 180 deg."""
    low = frequency <= max(LOWEST, frequency[1])
    return bool(np.sum((response[low] * np.exp(0.25j * np.pi) / np.abs(response[low])).real) < 0.0)


def _gains_at_rest(gains: dict[str, float]) -> list[Finding]:
    """One axis with another gain than the others, or all of them with one at which no loop would hold."""
    found = []
    for name, size in gains.items():
        others = [other for of, other in gains.items() if of != name]
        if others and max(size, 1.0 / size) > REST_GAIN < max(size / (usual := float(np.median(others))), usual / size):
            found.append(Finding("amplifier gain", (name,), f"{size:.2f} times the expected force; others {usual:.2f}"))
    if not found and any(max(size, 1.0 / size) > FORCE for size in gains.values()):
        text = ", ".join(f"{name} {size:.2f}" for name, size in gains.items())
        found.append(Finding("force", (), f"over mass, relative to the model: {text}; bias, mass, or scale of all axes"))
    return found


def _of_axis(name: str, one: AxisDynamics, late: float) -> list[Finding]:
    """Delay or low-pass of one axis."""
    if one.delay < late or one.delay < SURE * one.delay_error:
        return []
    if one.misfit[1] < 0.7 * one.misfit[0] and one.lag > 0.0:
        return [Finding("low-pass", (name,), f"of {1e3 * one.lag:.2g} ms: a filter of sensor or amplifier")]
    text = f"{one.delay:.1f} samples more than the model has: converters, or a step between measuring and writing"
    return [Finding("delay", (name,), text)]


def turn_of(ratio: NDArray[np.complex128], bench: Bench) -> dict[tuple[str, str], float]:
    """Tangent of the angle between sensors and magnets, by bearing; from H^-1 P."""
    names, found = bench.machine.axis_names, {}
    for bearing in bench.machine.bearings:
        axes = [axis for axis, one in enumerate(bench.machine.axes) if one.bearing == bearing.name]
        if len(axes) == 2:
            i, j = axes
            one, other = (np.median((ratio[:, a, b] / ratio[:, b, b]).real) for a, b in ((j, i), (i, j)))
            found[names[i], names[j]] = float(0.5 * (one - other))
    return found


def matrix_of(every: list[ToneResponse]) -> NDArray[np.complex128]:
    """Responses of all positions to the current of one axis after another, shape (tones, sensors, coils)."""
    return np.stack([one.position / one.current[:, axis : axis + 1] for axis, one in enumerate(every)], axis=2)


def levitated(bench: Bench, expected: Expected | None, ramp: float, moved: bool) -> list[Finding]:
    """Lift the rotor, compare noise, load, gains, delays and angles with the model, and land it.

    Parameters
    ----------
    bench, expected
        As in `before_lift`, which has found nothing.
    ramp : float
        Duration of the ramps (s).
    moved : bool
        Whether the sensors were checked by hand.
    """
    try:
        rest = bench.record(REST)
        record = bench.levitate(ramp, REST)
    except LostSamplesError:
        bench.off()
        raise
    except TargetError as problem:
        bench.off()
        return [Finding("target trips", (), str(problem))]
    trips = bench.status().trips
    if trips or not bench.levitated:
        bench.off()
        return [_not_lifted(record, bench, ", ".join(trip.reason.name for trip in trips))]
    still = record.window(record.first_step + record.steps - round(0.3 * bench.rate), round(0.3 * bench.rate))
    found = _of_noise(still, rest, bench)
    if not found and expected is not None:
        try:
            found = _of_dynamics(bench, expected, still, moved)
        except LostSamplesError:
            bench.off()
            raise
        except TargetError as problem:
            bench.off()
            return [Finding("unstable loop", (), str(problem))]
    bench.land(ramp)
    return found


def _not_lifted(record: LoopRecord, bench: Bench, trips: str) -> Finding:
    """A rotor that stays where it lies lacks force; one that swings has a loop that is not stable."""
    moved = np.ptp(record.position, axis=0)
    names = bench.machine.axis_names
    clearance = max(bearing.clearance for bearing in bench.machine.bearings)
    if moved.max() < 0.6 * clearance:
        axis = int(np.argmax(np.abs(record.current).max(axis=0)))
        return Finding("too little force", (names[axis],), f"the rotor is not lifted ({trips}): amplifier, bias, or load")
    return Finding("unstable loop", (), f"it swings by {UM * moved.max():.0f} um ({trips}): gains, damping, delay")


def _of_noise(still: LoopRecord, rest: LoopRecord, bench: Bench) -> list[Finding]:
    """Noise from sample to sample, which the motion of the rotor hardly changes, against that with the currents off."""
    found = []
    now, before = (np.diff(record.position, axis=0).std(axis=0) for record in (still, rest))
    for axis, name in enumerate(bench.machine.axis_names):
        if now[axis] > max(LEVITATED_NOISE * before[axis], 0.3e-6):
            text = f"{UM * now[axis]:.2g} um from sample to sample, {UM * before[axis]:.2g} um with the currents off"
            found.append(Finding("noise when on", (name,), text + ": amplifiers that disturb the sensors"))
    return found


def _of_dynamics(bench: Bench, expected: Expected, still: LoopRecord, moved: bool) -> list[Finding]:
    names = bench.machine.axis_names
    tones = tone_set(FAST_LOW, FAST_HIGH, FAST_TONES, WINDOW)
    wave = AMPLITUDE * tones.waveform(round((SETTLE + WINDOW) * bench.rate), bench.rate)
    every = []
    for axis in range(len(names)):
        samples = np.zeros((len(wave), len(names)))
        fade = min(500, len(wave))
        samples[:, axis] = wave * np.minimum(1.0, np.minimum(np.arange(len(wave)), np.arange(len(wave))[::-1]) / fade)
        record = bench.excite(samples)
        steps = round(WINDOW * bench.rate)
        every.append(response_to(tones, record.window(record.first_step + record.steps - steps - fade, steps)))
    outputs = np.stack([one.position for one in every], axis=2)
    inputs = np.stack([one.current for one in every], axis=2)
    response = outputs @ np.linalg.inv(inputs)
    found = dynamics_findings(response, tones.frequency, bench, expected, still, moved)
    return found or _saturation(bench, response, inputs, tones.frequency, np.stack([one.reference for one in every], 2))


def _saturation(
    bench: Bench,
    response: NDArray[np.complex128],
    inputs: NDArray[np.complex128],
    frequency: NDArray[np.float64],
    references: NDArray[np.complex128],
) -> list[Finding]:
    """A quarter of the bias current at a frequency at which it hardly moves the rotor: its motion is in proportion."""
    found: list[Finding] = []
    near = int(np.argmin(np.abs(frequency - LOUD)))
    loud = tone_set(frequency[near], frequency[near], 1, WINDOW)
    steps, fade = round((SETTLE + WINDOW) * bench.rate), 500
    for axis, name in enumerate(bench.machine.axis_names):
        of_reference = abs(inputs[near, axis, axis] / references[near, axis, axis])
        samples = np.zeros((steps, len(bench.machine.axes)))
        ramp = np.minimum(1.0, np.minimum(np.arange(steps), np.arange(steps)[::-1]) / fade)
        peak = SHARE * bench.machine.axes[axis].bias_current / of_reference
        samples[:, axis] = peak * ramp * loud.waveform(steps, bench.rate)
        record = bench.excite(samples)
        window = round(WINDOW * bench.rate)
        one = response_to(loud, record.window(record.first_step + record.steps - window - fade, window))
        ratio = abs(one.position[0, axis] / one.current[0, axis] / response[near, axis, axis])
        if ratio < LESS:
            text = f"at {abs(one.current[0, axis]):.2g} A it moves the rotor {100.0 * ratio:.0f} % as far as in proportion"
            found.append(Finding("amplifier saturates", (name,), text))
    return found


def dynamics_findings(
    response: NDArray[np.complex128],
    frequency: NDArray[np.float64],
    bench: Bench,
    expected: Expected,
    still: LoopRecord,
    moved: bool,
) -> list[Finding]:
    """Compare a measured plant with that of the model.

    Parameters
    ----------
    response : ndarray of complex, shape (tones, sensors, coils)
        Measured (m/A).
    frequency : ndarray, shape (tones,)
        (Hz).
    bench : Bench
        Machine and sample rate.
    expected : Expected
        Of the model.
    still : LoopRecord
        The levitated rotor at rest.
    moved : bool
        Whether the sensors were checked by hand.
    """
    names = bench.machine.axis_names
    inverse, of_model = np.linalg.inv(response), expected.plant.response(frequency)
    model = np.linalg.inv(of_model)
    found: list[Finding] = []
    for pair, angle in turn_of(inverse @ of_model, bench).items():
        if abs(angle) > TURN:
            text = f"sensors and magnets by {np.degrees(np.arctan(angle)):.0f} deg"
            found.append(Finding("coils turned" if moved else "turned", pair, text))
    every = [
        axis_dynamics(
            inverse[:, axis, axis], model[:, axis, axis], frequency, np.full(len(frequency), 0.02), expected.fastest,
            1.0 / bench.rate, contact=False,
        )
        for axis in range(len(names))
    ]  # fmt: skip
    for name, one in zip(names, every, strict=True):
        found += _of_axis(name, one, LATE)
    return found or _gains(every, bench, expected, still)


def _gains(every: list[AxisDynamics], bench: Bench, expected: Expected, still: LoopRecord) -> list[Finding]:
    """Factors of force over mass and over stiffness: of one axis, its amplifier; of all, mass or bias."""
    names = bench.machine.axis_names
    fast, slow = (np.array([getattr(one, name) for one in every]) for name in ("gain", "static_gain"))
    wrong = [axis for axis in range(len(names)) if not 1.0 / GAIN < fast[axis] < GAIN or not 1.0 / GAIN < slow[axis] < GAIN]
    if not wrong:
        return _load(bench, expected, still)
    text = ", ".join(f"{names[axis]} {fast[axis]:.2f} and {slow[axis]:.2f}" for axis in wrong)
    text = f"force over mass, and over stiffness, relative to the model: {text}"
    same = np.abs(np.log(np.abs(fast / slow))) < 0.5 * np.log(GAIN)
    if all(same[axis] for axis in wrong):
        return [Finding("amplifier gain", tuple(names[axis] for axis in wrong), text)]
    mass = np.abs(np.log(np.abs(slow))).max() < 0.5 * np.log(GAIN)
    return [Finding("mass" if mass else "bias or stiffness", (), text)]


def _load(bench: Bench, expected: Expected, still: LoopRecord) -> list[Finding]:
    found = []
    for axis, name in enumerate(bench.machine.axis_names):
        value, wanted = float(still.current[:, axis].mean()), float(expected.current[axis])
        if abs(value - wanted) > LOAD * bench.machine.axes[axis].bias_current:
            text = f"{value:.2f} A at rest, {wanted:.2f} A expected: another load, or an offset of sensor or amplifier"
            found.append(Finding("load", (name,), text))
    return found
