"""The parts `true` and `wrong`: verdicts on the truth about drawn data, and on models that are wrong in a known way.

A wrong model counts as tellable where a likelihood-ratio test of it against the truth, on the same data, has a p-value
below 1e-3. The degrees of freedom are the parameters that the fault has in a model of the bearing: a gain or a
stiffness for each axis, 2 (2 p + m) for the two states of a mode that is missing, one for a dead time or a frequency.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
from scipy import special

from amb_core.ground.errors import IdentificationError
from amb_core.identification import identify, validate
from amb_core.identification.validation import Verdict
from tests.benchmarks.verdicts.bearings import WRONG, draw_bearing, draw_data, oracle, wrong_model
from tests.benchmarks.verdicts.size import Size

TELLS = 1e-3
IDENTIFIED = 8
"""One true model of so many is also identified, from a second experiment of the same bearing."""
_SEED_TRUE, _SEED_WRONG = 2001, 2002


def true_models(size: Size) -> dict[str, Any]:
    """Verdicts on true models; every eighth bearing is identified too."""
    verdicts: Counter[str] = Counter()
    identified: Counter[str] = Counter()
    failed: Counter[str] = Counter()
    for seed in range(size.models):
        random = np.random.default_rng([_SEED_TRUE, seed])
        bearing = draw_bearing(random)
        data, _ = draw_data(bearing, random, size.steps)
        validation = validate(bearing.true_model(), data, bearing.controller)
        verdicts[validation.verdict] += 1
        failed.update(condition.key for condition in validation.failed)
        if seed % IDENTIFIED == 0:
            other, _ = draw_data(bearing, random, size.steps, like=data)
            try:
                model = identify(other, bearing.true_model().order, controller=bearing.controller).model
                identified[validate(model, data, bearing.controller).verdict] += 1
            except IdentificationError:  # data that do not excite every input
                identified["no model"] += 1
    return {
        "models": size.models,
        "validated": verdicts[Verdict.VALIDATED],
        "reserved": verdicts[Verdict.RESERVATIONS],
        "refused": verdicts[Verdict.NOT_VALIDATED],
        "identified": identified.total() - identified["no model"],
        "identified_validated": identified[Verdict.VALIDATED],
        "identified_refused": identified[Verdict.NOT_VALIDATED],
        "failed": dict(failed),
    }


def wrong_models(size: Size) -> dict[str, Any]:
    """Verdicts on wrong models, the faults in turn, until there are twice as many tellable ones as true models."""
    drawn, seed = 0, -1
    verdicts: Counter[str] = Counter()
    tellable: Counter[str] = Counter()
    refused: Counter[str] = Counter()
    while tellable.total() < 2 * size.models:
        seed += 1
        random = np.random.default_rng([_SEED_WRONG, seed])
        kind = WRONG[seed % len(WRONG)]
        bearing = draw_bearing(random)
        wrong = wrong_model(kind, bearing, random)
        if wrong is None:
            continue
        drawn += 1
        data, _ = draw_data(bearing, random, size.steps)
        ratio = oracle(bearing.true_model(), wrong, data)
        if special.chdtrc(degrees_of(kind, bearing.axes), max(ratio, 0.0)) >= TELLS:
            continue
        tellable[kind] += 1
        verdict = validate(wrong, data, bearing.controller).verdict
        verdicts[verdict] += 1
        refused[kind] += verdict is Verdict.NOT_VALIDATED
    return {
        "models": drawn,
        "tellable": tellable.total(),
        "refused": verdicts[Verdict.NOT_VALIDATED],
        "reserved": verdicts[Verdict.RESERVATIONS],
        "validated": verdicts[Verdict.VALIDATED],
        "refused_by_kind": dict(refused),
        "tellable_by_kind": dict(tellable),
    }


def degrees_of(kind: str, axes: int) -> int:
    """Parameters of a fault."""
    return {"gain": axes, "stiffness": axes, "order": 6 * axes, "swapped": axes, "sign": axes}.get(kind, 1)
