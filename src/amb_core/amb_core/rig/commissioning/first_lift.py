"""The first lift-off: noise, load, gains, delays, angles and amplifiers of the levitated rotor against the model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import TargetError
from amb_core.ground.units import UM
from amb_core.loop.records import LoopRecord
from amb_core.rig.commissioning.bench import DISTURBANCES, Bench
from amb_core.rig.commissioning.both_ways import TURN, late_findings, noise_when_on, turn_of
from amb_core.rig.commissioning.dynamics import AxisDynamics, axis_dynamics
from amb_core.rig.commissioning.expected import Expected
from amb_core.rig.commissioning.finding import Finding
from amb_core.rig.commissioning.tones import response_to, tone_set

REST, SETTLE, WINDOW = 0.3, 0.15, 0.5  # s
GAIN = 1.35  # factor from which on a gain is wrong
LATE = 0.6  # samples from which on there is a delay
AMPLITUDE = 2e-6  # m, of the tones
LOW, HIGH, TONES = 15.0, 900.0, 14  # Hz
LOUD, SHARE, LESS = 300.0, 0.25, 0.8  # Hz, of the bias current, of the motion in proportion
LOAD = 0.12  # of the bias current


def levitated(
    bench: Bench, expected: Expected | None, ramp: float, moved: bool, unchecked: list[str] | None = None
) -> list[Finding]:
    """Lift the rotor, compare noise, load, gains, delays and angles with the model, and land it, whatever comes of it.

    Parameters
    ----------
    bench : Bench
        The target, in which `before_lift` has found nothing; off.
    expected : Expected or None
        Of the model of the machine; None if there is none.
    ramp : float
        Duration of the ramps (s).
    moved : bool
        Whether the sensors were checked by hand.
    unchecked : list of str, optional
        What the excitation limits of the rig do not let it check is added to it; None if nobody wants to know.

    Returns
    -------
    list of Finding
        The faults found.

    Raises
    ------
    TargetError
        If the target refuses something without a trip, or telemetry is lost: that is no fault of the rig.
    """
    try:
        return _findings(bench, expected, ramp, moved, [] if unchecked is None else unchecked)
    finally:
        bench.down(ramp)


def _findings(bench: Bench, expected: Expected | None, ramp: float, moved: bool, unchecked: list[str]) -> list[Finding]:
    """What is found; the rotor may be up afterwards."""
    try:
        rest = bench.record(REST)
        record = bench.levitate(ramp, REST)
    except DISTURBANCES:
        raise
    except TargetError as problem:
        if not bench.status().trips:
            raise
        return [Finding("target trips", (), str(problem))]
    trips = bench.status().trips
    if trips or not bench.levitated:
        return [_not_lifted(record, bench, ", ".join(trip.reason.name for trip in trips))]
    still = record.window(record.first_step + record.steps - round(0.3 * bench.rate), round(0.3 * bench.rate))
    findings = noise_when_on(still, rest, bench.machine.axis_names)
    if findings or expected is None:
        return findings
    return _excited(bench, expected, still, moved, unchecked)


def _excited(bench: Bench, expected: Expected, still: LoopRecord, moved: bool, unchecked: list[str]) -> list[Finding]:
    """A loop that is not levitated any more is unstable; a refusal while it is levitated says nothing about the rig."""
    try:
        return _of_dynamics(bench, expected, still, moved, unchecked)
    except DISTURBANCES:
        raise
    except TargetError as problem:
        if bench.levitated:
            raise
        return [Finding("unstable loop", (), str(problem))]


def _not_lifted(record: LoopRecord, bench: Bench, trips: str) -> Finding:
    """A rotor that stays where it lies lacks force; one that swings has a loop that is not stable."""
    moved = np.ptp(record.position, axis=0)
    names = bench.machine.axis_names
    clearance = max(bearing.clearance for bearing in bench.machine.bearings)
    if moved.max() < 0.6 * clearance:
        axis = int(np.argmax(np.abs(record.current).max(axis=0)))
        return Finding(
            "too little force", (names[axis],), f"the rotor is not lifted ({trips}): amplifier, bias, or load"
        )
    return Finding("unstable loop", (), f"it swings by {UM * moved.max():.0f} um ({trips}): gains, damping, delay")


def _of_dynamics(
    bench: Bench, expected: Expected, still: LoopRecord, moved: bool, unchecked: list[str]
) -> list[Finding]:
    names = bench.machine.axis_names
    tones = tone_set(LOW, HIGH, TONES, WINDOW)
    wave = AMPLITUDE * tones.waveform(round((SETTLE + WINDOW) * bench.rate), bench.rate)
    every = []
    for axis in range(len(names)):
        samples = np.zeros((len(wave), len(names)))
        fade = min(500, len(wave))
        samples[:, axis] = wave * np.minimum(1.0, np.minimum(np.arange(len(wave)), np.arange(len(wave))[::-1]) / fade)
        if beyond := bench.beyond_limits(samples):
            unchecked.append(f"gains, delays and angles of the levitated rotor: {beyond}")
            return _load(bench, expected, still)
        record = bench.excite(samples)
        steps = round(WINDOW * bench.rate)
        every.append(response_to(tones, record.window(record.first_step + record.steps - steps - fade, steps)))
    outputs = np.stack([one.position for one in every], axis=2)
    inputs = np.stack([one.current for one in every], axis=2)
    response = outputs @ np.linalg.inv(inputs)
    findings = _dynamics_findings(response, tones.frequency, bench, expected, still, moved)
    references = np.stack([one.reference for one in every], axis=2)
    return findings or _saturation(bench, response, inputs, tones.frequency, references, unchecked)


def _saturation(
    bench: Bench,
    response: NDArray[np.complex128],
    inputs: NDArray[np.complex128],
    frequency: NDArray[np.float64],
    references: NDArray[np.complex128],
    unchecked: list[str],
) -> list[Finding]:
    """A quarter of the bias current at a frequency at which it hardly moves the rotor: its motion is in proportion."""
    findings: list[Finding] = []
    near = int(np.argmin(np.abs(frequency - LOUD)))
    loud = tone_set(frequency[near], frequency[near], 1, WINDOW)
    steps, fade = round((SETTLE + WINDOW) * bench.rate), 500
    for axis, name in enumerate(bench.machine.axis_names):
        of_reference = abs(inputs[near, axis, axis] / references[near, axis, axis])
        samples = np.zeros((steps, len(bench.machine.axes)))
        ramp = np.minimum(1.0, np.minimum(np.arange(steps), np.arange(steps)[::-1]) / fade)
        peak = SHARE * bench.machine.axes[axis].bias_current / of_reference
        samples[:, axis] = peak * ramp * loud.waveform(steps, bench.rate)
        if beyond := bench.beyond_limits(samples):
            unchecked.append(f"whether the amplifier of {name} saturates: {beyond}")
            continue
        record = bench.excite(samples)
        window = round(WINDOW * bench.rate)
        one = response_to(loud, record.window(record.first_step + record.steps - window - fade, window))
        ratio = abs(one.position[0, axis] / one.current[0, axis] / response[near, axis, axis])
        if ratio < LESS:
            text = (
                f"at {abs(one.current[0, axis]):.2g} A it moves the rotor {100.0 * ratio:.0f} % as far as in proportion"
            )
            findings.append(Finding("amplifier saturates", (name,), text))
    return findings


def _dynamics_findings(
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
    findings: list[Finding] = []
    for pair, angle in turn_of(inverse @ of_model, bench.machine).items():
        if abs(angle) > TURN:
            text = f"sensors and magnets by {np.degrees(np.arctan(angle)):.0f} deg"
            findings.append(Finding("coils turned" if moved else "turned", pair, text))
    every = [
        axis_dynamics(
            inverse[:, axis, axis], model[:, axis, axis], frequency, np.full(len(frequency), 0.02), expected.fastest,
            1.0 / bench.rate, contact=False,
        )
        for axis in range(len(names))
    ]  # fmt: skip
    for name, one in zip(names, every, strict=True):
        findings += late_findings(name, one, LATE)
    return findings or _gains(every, bench, expected, still)


def _gains(every: list[AxisDynamics], bench: Bench, expected: Expected, still: LoopRecord) -> list[Finding]:
    """Factors of force over mass and over stiffness: of one axis, its amplifier; of all, mass or bias."""
    names = bench.machine.axis_names
    fast, slow = (np.array([getattr(one, name) for one in every]) for name in ("gain", "static_gain"))
    wrong = [
        axis for axis in range(len(names)) if not 1.0 / GAIN < fast[axis] < GAIN or not 1.0 / GAIN < slow[axis] < GAIN
    ]
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
    findings = []
    for axis, name in enumerate(bench.machine.axis_names):
        value, wanted = float(still.current[:, axis].mean()), float(expected.current[axis])
        if abs(value - wanted) > LOAD * bench.machine.axes[axis].bias_current:
            text = f"{value:.2f} A at rest, {wanted:.2f} A expected: another load, or an offset of sensor or amplifier"
            findings.append(Finding("load", (name,), text))
    return findings
