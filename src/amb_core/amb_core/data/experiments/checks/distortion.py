"""Check of nonlinear distortion: how well a linear loop can fit these data."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from amb_core.data.experiments.checks.report import Finding, Severity
from amb_core.data.experiments.dataset import IdentificationData
from amb_core.data.experiments.tones import cure_tones
from amb_core.ground.errors import IdentificationError
from amb_core.regions.distortion import Evidence, find_evidence

LARGE_DISTORTION = 0.05
"""Distortion over the linear response that is worth a warning."""
LOW_COHERENCE = 0.3
"""Noise and distortion together over the explained motion that are: noise alone costs less than distortion."""


def evidence_of(data: IdentificationData, *, cured: bool = False) -> Evidence:
    """Distortion and coherence of records of the loop, with their trends; nothing, with the reason, of other data.

    Tones that the reference lacks are left out: an unbalance is no distortion.

    Parameters
    ----------
    data : IdentificationData
        Data of the closed loop.
    cured : bool, optional
        Whether the data are without such tones already, so that they are not sought again.

    Returns
    -------
    Evidence
        Both measures, or the reason why one is missing.
    """
    cure = None if cured else cure_tones(data)
    data = data if cure is None else cure.data
    try:
        records = [data.record(index) for index, item in enumerate(data.experiments) if item.reference is not None]
    except IdentificationError as problem:
        return Evidence(None, None, str(problem), str(problem))
    if not records:
        missing = "the data have no reference, which distortion is measured from"
        return Evidence(None, None, missing, missing)
    return replace(find_evidence(records), tones=() if cure is None else cure.frequencies)


def check_distortion(data: IdentificationData) -> Finding:
    """Distortion of the data, or coherence of position and reference; see `amb_core.regions.distortion`.

    Parameters
    ----------
    data : IdentificationData
        Data of the closed loop.

    Returns
    -------
    Finding
        A warning if the distortion is large or the coherence is low.
    """
    evidence = evidence_of(data)
    if evidence.distortion is None and evidence.coherence is None:
        return Finding("distortion", Severity.INFO, f"not measured: {evidence.coherence_problem}")
    large = [
        bool(np.any(measure.ratio > limit))
        for measure, limit in ((evidence.distortion, LARGE_DISTORTION), (evidence.coherence, LOW_COHERENCE))
        if measure is not None
    ]
    if not any(large):
        return Finding("distortion", Severity.INFO, evidence.brief)
    lowest = float(np.nanmin(evidence.best_fit))
    return Finding(
        "distortion",
        Severity.WARNING,
        evidence.brief,
        "",
        f"a linear loop fits to about {lowest:.0f} % at most; excite less, or lower frequencies",
    )
