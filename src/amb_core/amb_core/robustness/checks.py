"""Checks of a certificate against what the data show: band, error, assumptions, measured sensitivity, motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from amb_core.identification.uncertainty import ModelUncertainty
from amb_core.robustness.assessment import Assessment
from amb_core.robustness.feedback import Feedback
from amb_core.robustness.known_band import KnownBand
from amb_core.robustness.measured import COHERENT, MeasuredSensitivity
from amb_core.robustness.settings import ZONES, RobustnessSettings, Zone, zone_of

COVERED = "every frequency is covered by the data or by what is assumed"
MEASURED = "the sensitivity of a loop with this controller was measured"
NOT_RUN = "no data are of a loop with this controller"
ABOVE = 1.05  # measured sensitivity over its bound, from which it contradicts it
_LIGHT = 0.2  # damping ratio of a mode at most
_REACH = 2.58  # standard deviations
_ABOUT = 2.0**0.5  # half an octave to either side of a peak


@dataclass(frozen=True)
class Check:
    """One condition of a certificate.

    Attributes
    ----------
    name : str
        What is asked.
    passed : bool
        Whether it holds.
    finding : str
        What was found, with numbers.
    """

    name: str
    passed: bool
    finding: str


def band_checks(assessment: Assessment, known: KnownBand) -> list[Check]:
    """Whether the data know the plant well enough for the loop, and what is stated beyond their band."""
    settings, bounds = assessment.settings, assessment.bounds
    name = "the data show the response of the bearing"
    if bounds is None:
        finding = "the data say too little of the response, also where the sensitivity peaks; " + (
            "excite all axes from low to high frequencies, longer or with more amplitude"
            if known.band is not None
            else "they have no reference that moves all axes independently"
        )
        return [Check(name, False, finding)]
    # An error that the data show is there; one that they leave open may be.
    where = np.array([bounds.small_gain_frequency])
    assert known.band is not None
    shown, both = known.band.within(where)
    shows = known.low <= where[0] <= known.high and shown[0] > 0.5 * both[0]
    cause = "the data show an error of the response" if shows else "the data leave open an error of the response"
    checks = [
        Check(name, True, f"{known.text}"),
        Check(
            "no error of the response that the data leave open makes the loop unstable",
            bounds.small_gain < 1.0,
            f"{cause} at {where[0]:.4g} Hz of {bounds.small_gain:.2g} times that which the loop tolerates",
        ),
    ]
    worst = max(item.sensitivity.value for item in bounds.axes)
    return [*checks, Check(COVERED, known.whole, _beyond(known, worst, settings))]


def _beyond(known: KnownBand, worst: float, settings: RobustnessSettings) -> str:
    """What is stated beyond the band of the data, `worst` being the largest sensitivity in it."""
    percent = f"{100.0 * settings.confidence:g} %"
    assumed = (
        f"modes of damping ratio {settings.mode_damping:g} or more and {settings.mode_gain:g} times the rotor's own "
        "motion or less"
    )
    if known.whole:
        return f"data {known.text}; beyond, {assumed} use up {known.beyond:.2g} of what the loop tolerates"
    if known.reaches_up:
        return (
            f"sensitivity at most {worst:.3f} from {known.low:.3g} Hz with {percent}; no statement below, nor on "
            f"stability: slower modes could take {known.slower:.2g} times what the loop tolerates there; excite "
            "lower frequencies"
        )
    sides = [side for side, reached in (("below", known.reaches_down), ("above", known.reaches_up)) if not reached]
    share = f"could take {known.beyond:.2g} times what the loop tolerates there"
    if known.beyond < 1.0:
        share = f"use up {known.beyond:.2g} of what the loop tolerates there, too much for its bounds"
    return (
        f"sensitivity at most {worst:.3f} {known.text} with {percent}; no statement {' or '.join(sides)}, nor on "
        f"stability: {assumed} {share}"
    )


def assumption_check(
    feedback: Feedback, uncertainty: ModelUncertainty, known: KnownBand, settings: RobustnessSettings
) -> Check:
    """Whether the model has a mode with less damping than any is assumed to have, or lacks one that the data show.

    A mode of the model below what the data leave open is none that they show.
    """
    model, contradictions = uncertainty.model, []
    values, vectors = np.linalg.eig(model.a)
    seen, driven = model.c @ vectors, np.linalg.pinv(vectors) @ model.b
    for pole, spread in zip(model.poles(), uncertainty.pole_deviations(), strict=True):
        if pole.imag <= 0.0 or abs(pole) >= 1.0:
            continue
        rate = np.log(complex(pole))
        frequency, damping = abs(rate) / (2.0 * np.pi * model.sample_time), -rate.real / abs(rate)
        open_ = _REACH * float(np.linalg.norm(spread)) / abs(rate)
        if not (known.low <= frequency <= known.high and damping < _LIGHT and damping + open_ < settings.mode_damping):
            continue
        number, at = int(np.argmin(np.abs(values - pole))), np.array([frequency])
        peak = np.outer(seen[:, number], driven[number]) / (1.0 - abs(pole)) @ feedback.action(at)[0]
        shown, both = (0.0, 0.0) if known.band is None else (float(part[0]) for part in known.band.within(at))
        if np.linalg.norm(peak, 2) > both - shown:
            contradictions.append(f"the mode at {frequency:.4g} Hz has {damping:.3g} ± {open_:.1g}")
    lacking = [] if known.band is None else known.band.narrower.tolist()
    contradictions += [
        f"the mode that the model lacks at {frequency:.4g} Hz has less"
        for frequency in lacking
        if known.low <= frequency <= known.high
    ]
    name = "the data do not contradict the assumed least damping of modes"
    return Check(
        name,
        not contradictions,
        f"{', '.join(contradictions)}; assumed: at least {settings.mode_damping:g}"
        if contradictions
        else "they do not",
    )


def was_measured_check(measured: MeasuredSensitivity | None, assessment: Assessment, why_not: str = NOT_RUN) -> Check:
    """Whether the sensitivity of each axis was measured within half an octave of the peak that the model has."""
    if measured is None:
        return Check(MEASURED, False, why_not)
    lacking = []
    for number, axis in enumerate(assessment.axes):
        peak = axis.sensitivity.frequency
        about = (measured.frequency >= peak / _ABOUT) & (measured.frequency <= peak * _ABOUT)
        if not np.any(about & (measured.coherence[:, number] >= COHERENT)):
            lacking.append(f"{axis.name} about its peak at {peak:.4g} Hz")
    finding = f"the sensitivity was not measured well enough of axis {', '.join(lacking)}" if lacking else "it was"
    return Check(MEASURED, not lacking, finding)


def measured_checks(measured: MeasuredSensitivity, assessment: Assessment, settings: RobustnessSettings) -> list[Check]:
    """Whether the sensitivity that the data show lies below its bound wherever one is stated; empty without values."""
    name, bounds = "the measured sensitivity lies below its bound", assessment.bounds
    assert bounds is not None
    frequency = measured.frequency
    inside = (frequency >= bounds.frequency[0]) & (frequency <= bounds.frequency[-1])
    reach = float(ndtri(1.0 - (1.0 - settings.confidence) / max(len(frequency) * len(measured.axes), 1)))
    worst, finding = 0.0, ""
    for number, axis in enumerate(bounds.axes):
        lower = np.abs(measured.own[:, number]) - reach * measured.deviation[:, number]
        places = np.clip(np.searchsorted(bounds.frequency, frequency), 1, len(bounds.frequency) - 1)
        curve = axis.sensitivity.curve
        limit = np.maximum(curve[places - 1], curve[places])
        counted = inside & (measured.coherence[:, number] >= COHERENT)
        if not np.any(counted):
            continue
        ratio = np.where(counted, lower / limit, 0.0)
        place = int(np.argmax(ratio))
        if ratio[place] >= worst:
            worst = float(ratio[place])
            finding = (
                f"axis {axis.name} at {frequency[place]:.4g} Hz: measured at least {max(lower[place], 0.0):.3f}, bound "
                f"{limit[place]:.3f}"
            )
    return [Check(name, worst <= ABOVE, finding)] if finding else []


def displacement_check(zones: Mapping[str, Zone], settings: RobustnessSettings) -> Check:
    """Whether the largest displacement in the data lies in the needed zone after ISO 14839-2."""
    worst = max(zones, key=lambda name: ZONES.index(zones[name]))
    return Check(
        f"zone {settings.needed_zone} or better after ISO 14839-2",
        ZONES.index(zones[worst]) <= ZONES.index(settings.needed_zone),
        f"displacement at axis {worst} from the middle over the clearance: zone {zones[worst]}",
    )


def amplitude_check(amplitude: Mapping[str, float], settings: RobustnessSettings) -> Check:
    """Whether the data move as far as the bearing will in operation."""
    least = min(amplitude, key=lambda name: amplitude[name])
    return Check(
        "the data move as far as the bearing will in operation",
        amplitude[least] >= settings.operation_amplitude,
        f"axis {least} moves {1e6 * amplitude[least]:.3g} um from its middle in the data; operation: "
        f"{1e6 * settings.operation_amplitude:.3g} um",
    )


def measured_peak_check(measured: MeasuredSensitivity, settings: RobustnessSettings) -> Check:
    """The zone of the largest measured sensitivity, its uncertainty added."""
    peaks = [(*measured.peak(number, settings.confidence), name) for number, name in enumerate(measured.axes)]
    value, frequency, name = max(peaks)
    zone, percent = zone_of(value, settings.sensitivity_limits), f"{100.0 * settings.confidence:g} %"
    return Check(
        f"measured by a swept sine: zone {settings.needed_zone} or better after ISO 14839-3",
        ZONES.index(zone) <= ZONES.index(settings.needed_zone),
        f"measured peak sensitivity of axis {name} at most {value:.3f} with {percent}, at {frequency:.4g} Hz: "
        f"zone {zone}",
    )
