"""Commissioning of a rig: what each step measures, its limits, what is expected of a model, and the protocol."""

from amb_core.rig.commissioning.bench import Bench
from amb_core.rig.commissioning.diagnosis import Diagnosis, before_lift, diagnose
from amb_core.rig.commissioning.expected import Expected, expected_of
from amb_core.rig.commissioning.experiments import multisine, order_for, order_of_rig, small_steps, sweep, tone
from amb_core.rig.commissioning.finding import Finding
from amb_core.rig.commissioning.first_lift import levitated
from amb_core.rig.commissioning.levitation import levitation_checks, rest_checks, runaway
from amb_core.rig.commissioning.protocol import Check, Protocol, Step, at_most, between, measured
from amb_core.rig.commissioning.response import (
    ClosedLoop,
    StaticResponse,
    closed_loop,
    fit_second_order,
    static_response,
)
from amb_core.rig.commissioning.sensors_at_rest import PUSHES
from amb_core.rig.commissioning.settings import CommissioningSettings
from amb_core.rig.commissioning.verdicts import calibration_checks, fade_checks, model_checks, resonance_checks

__all__ = [
    "PUSHES",
    "Bench",
    "Check",
    "ClosedLoop",
    "CommissioningSettings",
    "Diagnosis",
    "Expected",
    "Finding",
    "Protocol",
    "StaticResponse",
    "Step",
    "at_most",
    "before_lift",
    "between",
    "calibration_checks",
    "closed_loop",
    "diagnose",
    "expected_of",
    "fade_checks",
    "fit_second_order",
    "levitated",
    "levitation_checks",
    "measured",
    "model_checks",
    "multisine",
    "order_for",
    "order_of_rig",
    "resonance_checks",
    "rest_checks",
    "runaway",
    "small_steps",
    "static_response",
    "sweep",
    "tone",
]
