"""The content of certificate.json: every number of a certificate, in SI units; those that are not finite are null."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np

from amb_core.ground.results import plain
from amb_core.robustness.assessment import Assessment, AxisResult, Bounds
from amb_core.robustness.certificate import Certificate
from amb_core.robustness.known_band import KnownBand
from amb_core.robustness.margins import reciprocal
from amb_core.robustness.measured import MeasuredSensitivity


def certificate_values(certificate: Certificate) -> dict[str, Any]:
    """All numbers as plain values for strict JSON; values that are not finite are None.

    Parameters
    ----------
    certificate : Certificate
        From `certify`.

    Returns
    -------
    dict of str to object
        Values by name.
    """
    return dict(plain(_values(certificate)))


def certificate_json(certificate: Certificate) -> str:
    """The content of certificate.json."""
    return json.dumps(certificate_values(certificate), indent=2, allow_nan=False) + "\n"


def _values(certificate: Certificate) -> dict[str, Any]:
    values: dict[str, Any] = {
        "certified": certificate.certified,
        "statement": certificate.statement,
        "reserved": certificate.reserved,
        "verdict": certificate.verdict,
        "checks": [{"name": one.name, "passed": one.passed, "finding": one.finding} for one in certificate.checks],
        "warnings": list(certificate.warnings),
        "settings": certificate.settings.model_dump(),
        "inputs": {name: {"sha256": value} for name, value in certificate.inputs.items()},
        "zones_iso_14839_2": dict(certificate.displacement or {}),
        "amplitude": dict(certificate.amplitude or {}),
        **(certificate.trace.values() if certificate.trace is not None else {}),
    }
    if certificate.known is not None:
        values["band"] = _band_values(certificate.known)
    assessment = certificate.assessment
    if assessment is None:
        return values
    if certificate.measured is not None:
        values["measured"] = compared_values(certificate.measured, assessment)
    values |= {
        "axes": {axis.name: _axis_values(axis) for axis in assessment.axes},
        "peak_sensitivity": _peak(assessment.sensitivity),
        "peak_complementary": _peak(assessment.complementary),
        "disk_margins": [
            {"where": one.where, "guaranteed": one.guaranteed, "broken": one.broken, "frequency": one.frequency}
            for one in assessment.disks
        ],
        "mu": _mu_values(assessment),
    }
    if assessment.bounds is not None:
        values["bounds"] = {"confidence": assessment.settings.confidence, **_bound_values(assessment.bounds)}
    return values


def _band_values(known: KnownBand) -> dict[str, Any]:
    return {
        "low": known.low,
        "high": known.high,
        "whole": known.whole,
        "slower": known.slower,
        "beyond": known.beyond,
    }


def _axis_values(axis: AxisResult) -> dict[str, Any]:
    return {
        "peak_sensitivity": _peak(axis.sensitivity),
        "peak_complementary": _peak(axis.complementary),
        "gain_margin_up": _peak(axis.margins.gain_up),
        "gain_margin_down": _peak(axis.margins.gain_down),
        "phase_margin_degrees": _peak(axis.margins.phase, 180.0 / math.pi),
        "delay_margin_seconds": _peak(axis.margins.delay),
        "disk_margin": axis.disk.guaranteed,
        "zone_iso_14839_3": axis.zone,
    }


def _mu_values(assessment: Assessment) -> dict[str, Any]:
    mu = assessment.mu
    return {
        "upper": mu.upper,
        "lower": mu.lower,
        "gap": mu.gap,
        "frequency": mu.frequency,
        "worst_case": {
            "frequency": mu.lower_frequency,
            "distance_from_unit_circle": assessment.on_circle,
            "perturbation": {
                block.name: [value.real, value.imag]
                for block, value in zip(assessment.uncertain.blocks, mu.perturbation.tolist(), strict=False)
            },
        },
    }


def _bound_values(bounds: Bounds) -> dict[str, Any]:
    return {
        "axes": {
            one.name: {
                "peak_sensitivity": one.sensitivity.value,
                "peak_complementary": one.complementary.value,
                "disk_margin": reciprocal(one.disk.value),
                "peak_sensitivity_all_parameters": one.sensitivity_of_all.value,
                "zone_iso_14839_3": one.zone,
            }
            for one in bounds.axes
        },
        "disk_margin_outputs": reciprocal(bounds.outputs.value),
        "small_gain": bounds.small_gain,
        "nu_gap": bounds.gap.worst.value,
        "stability_margin_b": bounds.gap.margin,
        "unstable_poles": [
            {"poles": [[pole.real, pole.imag] for pole in one.poles.tolist()], "magnitude": [one.lowest, one.highest]}
            for one in bounds.poles
        ],
    }


def compared_values(measured: MeasuredSensitivity, assessment: Assessment) -> dict[str, Any]:
    """The measured sensitivity and its difference from the model's up to 1 kHz, where it is comparable."""
    difference = np.abs(measured.difference_db(assessment.feedback))
    compared = measured.frequency[measured.comparable()]
    return {
        "method": measured.method,
        "peaks": {name: measured.peak(number, 0.5)[0] for number, name in enumerate(measured.axes)},
        "worst_difference_db": float(difference.max()) if difference.size else math.nan,
        "median_difference_db": float(np.median(difference)) if difference.size else math.nan,
        "frequencies": int(difference.shape[1]),
        "from_hz": float(compared.min()) if compared.size else math.nan,
        "to_hz": float(compared.max()) if compared.size else math.nan,
    }


def _peak(peak: Any, factor: float = 1.0) -> dict[str, float]:
    return {"value": peak.value * factor, "frequency": peak.frequency}
