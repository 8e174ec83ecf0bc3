"""What is wrong with a rig: from rest by way of small currents on its backup bearing to the levitated rotor.

Nothing is levitated before what can be known at rest is known, and the currents until then are so small that the rotor
stays where it lies, whatever is wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import TargetError
from amb_core.loop.records import LoopRecord
from amb_core.rig.commissioning.bench import DISTURBANCES, Bench
from amb_core.rig.commissioning.expected import Expected
from amb_core.rig.commissioning.finding import Finding
from amb_core.rig.commissioning.first_lift import REST, levitated
from amb_core.rig.commissioning.on_the_backup_bearing import on_the_backup_bearing
from amb_core.rig.commissioning.sensors_at_rest import (
    hand_findings,
    noise_findings,
    place_findings,
    resolution_findings,
    stiff_sensors,
)
from amb_core.rig.commissioning.settings import CommissioningSettings

Hand = Callable[[Bench], Mapping[str, Mapping[str, NDArray[np.float64]]]]
"""Has the rotor pushed by hand in every bearing, see `hand_findings`; returns the measured positions."""

UNCLEAR = ("sensor noise", "sensor hum", "sensor coarse")
"""Nothing small can be measured with such a sensor."""


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
    bench : Bench
        The target, off.
    expected : Expected or None
        Of the model of the machine; without it no gain, angle or delay is compared.
    hand : Hand, optional
        Has the rotor moved by hand, as for `before_lift`; returns the measured positions (m), shape (steps, axes), by
        bearing and push. Without it, sensors and coils that are both reversed are not noticed.
    ramp : float, optional
        Duration of the ramp of the first levitation (s).

    Returns
    -------
    Diagnosis
        The faults found, and what was not checked.
    """
    result = before_lift(bench, expected, hand)
    if not result.findings:
        result.levitated = True
        result.findings += levitated(bench, expected, ramp, hand is not None, result.unchecked)
    return result


def before_lift(
    bench: Bench, expected: Expected | None, hand: Hand | None = None, settings: CommissioningSettings | None = None
) -> Diagnosis:
    """Find what can be found while the rotor lies on its backup bearing.

    Parameters
    ----------
    bench : Bench
        The target, off.
    expected : Expected, optional
        Of the model of the machine; without it no gain, angle or delay is compared.
    hand : Hand, optional
        Has the rotor moved by hand; returns the measured positions (m), shape (steps, axes), by bearing and push.
        Without it, sensors and coils that are both reversed are not noticed.
    settings : CommissioningSettings, optional
        Largest noise and radius of the resting rotor; by default the defaults.

    Returns
    -------
    Diagnosis
        The faults found, and what was not checked.
    """
    result = Diagnosis()
    rest = at_rest(bench, hand, result, settings or CommissioningSettings())
    if expected is None:
        result.unchecked.append("gains, angles and delays, since the parameter file has no model of the machine")
    if rest is None:
        return result
    dead = [axis for one in result.findings if one.fault == "sensor dead" for axis in one.axes]
    try:
        result.findings += on_the_backup_bearing(bench, expected, hand is not None, result.findings, dead, rest)
    except DISTURBANCES:
        raise
    except TargetError as problem:
        bench.off()
        trips = ", ".join(trip.reason.name for trip in bench.status().trips)
        if result.findings:  # of a sensor that shows more than the target takes, for example
            result.unchecked.append(f"coils and amplifiers: {problem}")
        else:
            result.findings.append(Finding("target trips", (), f"{problem} ({trips or 'no trip'})"))
    return result


def at_rest(bench: Bench, hand: Hand | None, result: Diagnosis, settings: CommissioningSettings) -> LoopRecord | None:
    """Trips, noise, resting place, and the rotor moved by hand; None if nothing can go on."""
    names = bench.machine.axis_names
    if trips := bench.status().trips:
        result.findings.append(Finding("target trips", (), ", ".join(str(trip.reason.name) for trip in trips)))
        if any(trip.reason.name != "SENSOR_RANGE" for trip in trips):
            return None
    record = bench.record(REST)
    result.findings += noise_findings(record.position, names, settings.noise)
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
        stuck = [
            Finding("sensor dead", (names[axis],), "it repeats one value") for axis in stiff_sensors(record.position)
        ]
        by_hand = stuck or place_findings(record.position.mean(axis=0), bench.machine, settings.rest_share)
    result.findings += by_hand
    return None if any(one.fault in UNCLEAR for one in result.findings) else record
