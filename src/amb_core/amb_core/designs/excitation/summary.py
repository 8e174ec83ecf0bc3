"""Results of check and design as plain values in SI units, for a file or a message."""

from __future__ import annotations

from typing import Any

from amb_core.designs.excitation.design import DesignedExcitation
from amb_core.designs.excitation.measures import DEVIATION, AxisMeasure
from amb_core.designs.excitation.result import AxisCheck, ExcitationCheck
from amb_core.designs.excitation.trial import Trial
from amb_core.ground.results import plain


def check_summary(check: ExcitationCheck) -> dict[str, Any]:
    """An excitation check; loads, shares and factors are pure numbers."""
    return {
        "kind": check.kind,
        "verdict": check.verdict,
        "predicted": check.predicted.name,
        "certain": check.certain,
        "margin": check.margin,
        "map_margin": check.map_margin,
        "shares": {region.name: share for region, share in check.shares.items()},
        "axes": {axis.axis: _axis(axis) for axis in check.axes},
        "bias_current": check.bias_current,
        "current_limit": check.current_limit,
        "slew_rate": check.slew_rate,
        "notes": list(check.notes),
    }


def trial_summary(trial: Trial) -> dict[str, Any]:
    """A trial in simulation; times count from the release of the rotor."""
    return {
        "region": trial.region.name,
        "classified": trial.classified.name,
        "onsets": {region.name: onset.time for region, onset in trial.onsets.items()},
        "bias_shift": plain(trial.bias_shift),
        "measure": DEVIATION,
        "axes": {measure.axis: measure_summary(measure) for measure in trial.measures},
    }


def measure_summary(measure: AxisMeasure) -> dict[str, float]:
    """Measures of an axis; shares of samples are pure numbers."""
    return {
        "deviation_percent": 100.0 * measure.deviation,
        "fit_percent": measure.fit,
        "clipped": measure.clipped,
        "slewed": measure.slewed,
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
        "amplitude": design.amplitude,
        "largest_amplitude": design.largest_amplitude,
        "beyond_amplitude": plain(beyond),
        "limited_by": design.limited_by,
        "limits": design.limits.model_dump(),
        "seeds": len(design.certificate.trials),
        "measure": DEVIATION,
        "axes": {measure.axis: measure_summary(measure) for measure in worst},
        "distortion_percent": None
        if distortion is None
        else {item.axis: 100.0 * float(distortion.ratio[distortion.axes.index(item.axis)]) for item in worst},
        "distortion_upper_percent": None
        if distortion is None
        else {item.axis: 100.0 * float(distortion.upper_ratio[distortion.axes.index(item.axis)]) for item in worst},
        "identifiable_order": design.excited_order.order,
        "identifiable_order_tried": design.excited_order.tried,
        "tried": [
            {"amplitude": tried.amplitude, "region": tried.region.name, "most_used": tried.use}
            for tried in design.tried
        ],
        "trial": trial_summary(design.trial),
        "map_amplitude": predicted,
    }


def _axis(axis: AxisCheck) -> dict[str, Any]:
    load = axis.load
    return {
        "form": axis.form,
        "shares": {region.name: share for region, share in axis.shares.items()},
        "load": {
            **{region.name: value for region, value in load.towards.items()},
            "linear": load.linear,
            "bounded": load.bounded,
            "continued": load.continued,
        },
        "rms": axis.rms,
        "peak": axis.peak,
        "crest_factor": axis.crest_factor,
        "static_current": axis.static_current,
        "command_rms": axis.command_rms,
        "command_peak": axis.command_peak,
        "slew_rms": axis.slew_rms,
        "slew_peak": axis.slew_peak,
        "limited": axis.limited,
        "slewed": axis.slewed,
        "current_margin": plain(axis.current_margin),
        "slew_margin": plain(axis.slew_margin),
        "points": [
            {
                "frequency": frequency,
                "amplitude": amplitude,
                "share": share,
                "region": "ABCD"[region],
                "covered": covered,
            }
            for frequency, amplitude, share, region, covered in zip(
                axis.frequency.tolist(), axis.amplitude.tolist(), axis.share.tolist(), axis.region.tolist(),
                axis.covered.tolist(), strict=True,
            )
        ],
    }  # fmt: skip
