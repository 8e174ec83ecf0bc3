"""Results of check and design as plain values with units in their names, for a file or a message."""

from __future__ import annotations

import math
from typing import Any

from amb_core.excitation_design.design import DesignedExcitation
from amb_core.excitation_design.measures import DEVIATION, AxisMeasure
from amb_core.excitation_design.result import AxisCheck, ExcitationCheck
from amb_core.excitation_design.trial import Trial
from amb_core.units import UM


def check_summary(check: ExcitationCheck) -> dict[str, Any]:
    """An excitation check; loads, shares and factors are pure numbers."""
    return {
        "kind": check.kind,
        "verdict": check.verdict,
        "predicted": check.predicted.name,
        "certain": check.certain,
        "margin": round(check.margin, 4),
        "map_margin": round(check.map_margin, 4),
        "shares": {region.name: round(share, 6) for region, share in check.shares.items()},
        "axes": {axis.axis: _axis(axis) for axis in check.axes},
        "bias_current_a": check.bias_current,
        "current_limit_a": check.current_limit,
        "slew_rate_a_per_s": None if check.slew_rate is None else round(check.slew_rate, 1),
        "notes": list(check.notes),
    }


def trial_summary(trial: Trial) -> dict[str, Any]:
    """A trial in simulation; times count from the release of the rotor."""
    return {
        "region": trial.region.name,
        "classified": trial.classified.name,
        "onsets_s": {region.name: round(onset.time, 4) for region, onset in trial.onsets.items()},
        "bias_shift_um": [None if math.isnan(shift) else round(UM * shift, 4) for shift in trial.bias_shift.tolist()],
        "measure": DEVIATION,
        "axes": {measure.axis: measure_summary(measure) for measure in trial.measures},
    }


def measure_summary(measure: AxisMeasure) -> dict[str, float]:
    """Measures of an axis; shares of samples are pure numbers."""
    return {
        "deviation_percent": round(100.0 * measure.deviation, 4),
        "fit_percent": round(measure.fit, 3),
        "clipped": round(measure.clipped, 6),
        "slewed": round(measure.slewed, 6),
    }


def design_summary(design: DesignedExcitation) -> dict[str, Any]:
    """A designed excitation: its parameters (SI units), how it was found, and what simulations of it showed.

    Of the map it has the prediction only: the simulations decide, so no verdict of the map stands beside theirs.
    """
    beyond, predicted = design.beyond_amplitude, design.predicted_amplitude
    distortion, worst = design.distortion, design.certificate.worst
    return {
        "kind": design.signal.kind,
        "verdict": design.verdict,
        "parameters": design.signal.parameters.model_dump(),
        "amplitude_um": round(UM * design.amplitude, 4),
        "largest_amplitude_um": round(UM * design.largest_amplitude, 4),
        "beyond_amplitude_um": None if math.isinf(beyond) else round(UM * beyond, 4),
        "limited_by": design.limited_by,
        "limits": design.limits.model_dump(),
        "seeds": len(design.certificate.trials),
        "measure": DEVIATION,
        "axes": {measure.axis: measure_summary(measure) for measure in worst},
        "distortion_percent": None
        if distortion is None
        else {item.axis: round(100.0 * float(distortion.ratio[distortion.axes.index(item.axis)]), 4) for item in worst},
        "distortion_upper_percent": None
        if distortion is None
        else {
            item.axis: round(100.0 * float(distortion.upper_ratio[distortion.axes.index(item.axis)]), 4)
            for item in worst
        },
        "identifiable_order": design.excited_order.order,
        "identifiable_order_tried": design.excited_order.tried,
        "tried": [
            {"amplitude_um": round(UM * tried.amplitude, 4), "region": tried.region.name, "most_used": tried.use}
            for tried in design.tried
        ],
        "trial": trial_summary(design.trial),
        "map_amplitude_um": None if predicted is None else round(UM * predicted, 4),
    }


def _axis(axis: AxisCheck) -> dict[str, Any]:
    load = axis.load
    return {
        "form": axis.form,
        "shares": {region.name: round(share, 6) for region, share in axis.shares.items()},
        "load": {
            **{region.name: round(value, 4) for region, value in load.towards.items()},
            "linear": round(load.linear, 4),
            "bounded": round(load.bounded, 4),
            "continued": round(load.continued, 4),
        },
        "rms_um": round(UM * axis.rms, 4),
        "peak_um": round(UM * axis.peak, 4),
        "crest_factor": round(axis.crest_factor, 4),
        "static_current_a": round(axis.static_current, 4),
        "command_rms_a": round(axis.command_rms, 4),
        "command_peak_a": round(axis.command_peak, 4),
        "slew_rms_a_per_s": round(axis.slew_rms, 1),
        "slew_peak_a_per_s": round(axis.slew_peak, 1),
        "limited": round(axis.limited, 6),
        "slewed": round(axis.slewed, 6),
        "current_margin": _finite(axis.current_margin),
        "slew_margin": _finite(axis.slew_margin),
        "points": [
            {
                "frequency_hz": round(frequency, 3),
                "amplitude_um": round(UM * amplitude, 5),
                "share": round(share, 7),
                "region": "ABCD"[region],
                "covered": covered,
            }
            for frequency, amplitude, share, region, covered in zip(
                axis.frequency.tolist(), axis.amplitude.tolist(), axis.share.tolist(), axis.region.tolist(),
                axis.covered.tolist(), strict=True,
            )
        ],
    }  # fmt: skip


def _finite(factor: float) -> float | None:
    return round(factor, 4) if math.isfinite(factor) else None
