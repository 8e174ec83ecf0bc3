"""Steps of a sensor: single errors of the ARX model that leave a lasting level.

A sensor that jumps by d at sample k gives the errors d at k and A(1) d for good afterwards. A disturbance that only
hits one sample, or a force on the rotor, leaves no level. A low-pass part that is taken out of the data does not hold a
step, so steps are subtracted before.

Source: R. S. Tsay, Outliers, level shifts, and variance changes in time series, Journal of Forecasting 7 (1988).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from amb_core.data.experiments.dataset import IdentificationData
from amb_core.data.experiments.drift.autoregression import LAGS, Autoregression, scales, signals_of

MOST_STEPS = 10  # of one experiment
_OUTLIER = 10.0  # standard deviations of an error; noise does not reach it
_REACH = 1_000  # samples on either side that show the level
_KEPT = (0.5, 1.5)  # share of the level that a step predicts; an outlier leaves none
_CERTAIN = 5.0  # standard errors of the share
_NORMAL = 1.4826  # standard deviation over the median magnitude


@dataclass(frozen=True)
class SensorStep:
    """A step of the outputs that the inputs do not explain.

    Attributes
    ----------
    experiment : int
        Index of the experiment.
    step : int
        First sample after it, counted as in the experiment.
    size : ndarray, shape (p,)
        Change of each output (its unit).
    """

    experiment: int
    step: int
    size: NDArray[np.float64]


def find_steps(data: IdentificationData, model: Autoregression) -> list[SensorStep]:
    """The steps of all experiments, in order."""
    scale = scales(data)[len(data.input_names) :]
    steps = []
    for index, (item, signals) in enumerate(zip(data.experiments, signals_of(data), strict=True)):
        errors = model.errors(signals)
        for row in _outliers(errors):
            if _lasts(errors, row, model.static_gain):
                steps.append(SensorStep(index, item.first_step + LAGS + row, errors[row] * scale))
    return steps


def without_steps(data: IdentificationData, steps: list[SensorStep]) -> IdentificationData:
    """The data with the steps subtracted from the outputs."""
    experiments = list(data.experiments)
    for step in steps:
        item = experiments[step.experiment]
        outputs = item.outputs.copy()
        outputs[step.step - item.first_step :] -= step.size
        experiments[step.experiment] = replace(item, outputs=outputs)
    return replace(data, experiments=tuple(experiments))


def _outliers(errors: NDArray[np.float64]) -> list[int]:
    """Rows with large errors, the first of each cluster of `LAGS` rows, the largest ones if there are many."""
    deviation = _NORMAL * np.median(np.abs(errors), axis=0)
    size = np.max(np.abs(errors) / np.maximum(deviation, np.finfo(float).tiny), axis=1)
    rows: list[int] = []
    for row in np.flatnonzero(size > _OUTLIER).tolist():
        if not rows or row - rows[-1] > LAGS:
            rows.append(row)
    return sorted(sorted(rows, key=lambda row: -size[row])[:MOST_STEPS])


def _lasts(errors: NDArray[np.float64], row: int, static_gain: NDArray[np.float64]) -> bool:
    """Whether the level after a row differs from that before it as a step of that size makes it differ."""
    before, after = errors[max(row - _REACH, 0) : row], errors[row + LAGS : row + LAGS + _REACH]
    if min(len(before), len(after)) < 10 * LAGS:
        return False
    predicted = static_gain @ errors[row]
    change = after.mean(axis=0) - before.mean(axis=0)
    deviation = _NORMAL * np.median(np.abs(errors), axis=0) * np.sqrt(1.0 / len(before) + 1.0 / len(after))
    weight = predicted / deviation**2
    information = float(weight @ predicted)
    share = float(weight @ change) / information
    return information > _CERTAIN**2 and _KEPT[0] < share < _KEPT[1]
