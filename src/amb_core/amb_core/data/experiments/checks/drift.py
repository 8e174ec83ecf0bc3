"""Check for slow drift of the outputs, of any shape."""

from __future__ import annotations

from amb_core.data.experiments.checks.report import Finding, Severity
from amb_core.data.experiments.dataset import IdentificationData
from amb_core.data.experiments.drift import find_drift
from amb_core.data.experiments.drift.find import FEWEST_SAMPLES, LEVEL


def check_drift(data: IdentificationData) -> Finding:
    """Slow changes of the outputs that neither the inputs nor white noise explain.

    Drift correlates with itself over the whole recording, and through the feedback with the inputs. A model without
    states for it explains part of it by a pole near 1, which the plant does not have, or shifts its slow poles.
    """
    drift = find_drift(data)
    if drift is None:
        return Finding(
            "drift", Severity.INFO, f"not checked: fewer than {FEWEST_SAMPLES} samples, or a constant signal"
        )
    if not drift.found:
        return Finding("drift", Severity.INFO, "the outputs do not drift")
    labels = zip(data.output_names, data.output_units, drift.power, drift.size, strict=True)
    drifting = {name: f"{size:.2g} {unit}".strip() for name, unit, power, size in labels if power > LEVEL}
    return Finding(
        "drift",
        Severity.WARNING,
        f"slow drift by about {', '.join(drifting.values())}, up to {drift.power.max():.2g} times the power of the "
        "noise; a model may explain it by a pole near 1 and have an unstable loop",
        ", ".join(drifting),
        "identify removes it with drift = auto, not with none; elsewhere use cure_drift(data)",
    )
