"""Data of a validation without the slow drift of their sensors: it says nothing of the plant, as tones do not.

A high-pass filter of all signals leaves the responses between them as they are (see `cure_drift`). The means stay, and
drift has moved them too, by how much since the identification the data do not show. A difference to the operating point
of the model that such drift explains is taken for drift; a larger one is another load or operating point.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from amb_core.data.experiments import Experiment, Finding, IdentificationData, Severity, restore
from amb_core.data.experiments.drift import DriftCure, cure_drift, high_pass
from amb_core.data.experiments.drift.find import LEVEL, long_enough
from amb_core.data.experiments.drift.steps import SensorStep, without_steps
from amb_core.linear.model.state_space import StateSpaceModel

_BEFORE = 3.0  # times its range in the data, that drift may have moved the means since the identification


@dataclass(frozen=True)
class Undrifted:
    """Data without drift.

    Attributes
    ----------
    data : IdentificationData
        The data without drift, with removed trends added again.
    finding : Finding
        What was removed, for the verdict.
    size : ndarray, shape (p,)
        Range of the drift of each output (its unit); 0 for those that do not drift.
    corner : float
        Frequency (Hz) below which the data say nothing of the plant: what is left of the drift is there.
    """

    data: IdentificationData
    finding: Finding
    size: NDArray[np.float64]
    corner: float


def undrifted(data: IdentificationData) -> Undrifted | None:
    """The data without the drift of their outputs; None where nothing drifts.

    Parameters
    ----------
    data : IdentificationData
        Data with finite values.

    Returns
    -------
    Undrifted or None
        The filtered data. Experiments too short for the filter are left out.
    """
    cure = cure_drift(data)
    if cure is None or cure.drift is None:
        return None
    size = np.where(cure.drift.power > LEVEL, cure.drift.size, 0.0)
    filtered = cure.data if not cure.steps else high_pass(_without_steps(data, cure.steps), cure.window)
    return Undrifted(restore(filtered), _finding(data, cure, size), size, cure.corner)


def levelled(data: IdentificationData, model: StateSpaceModel, size: NDArray[np.float64]) -> IdentificationData:
    """The data with means that agree with the operating point of a model where drift explains the difference.

    Positions and references move alike, so that the currents remain those of the controller.

    Parameters
    ----------
    data : IdentificationData
        Data without drift.
    model : StateSpaceModel
        The model.
    size : ndarray, shape (p,)
        Range of the drift of each output (its unit).

    Returns
    -------
    IdentificationData
        The data, as they are where the model has no static gain.
    """
    at_one = np.eye(model.order) - model.a
    try:
        gain = model.c @ np.linalg.solve(at_one, model.b) + model.d
    except np.linalg.LinAlgError:
        return data
    return replace(data, experiments=tuple(_levelled(item, model, gain, size) for item in data.experiments))


def _without_steps(data: IdentificationData, steps: tuple[SensorStep, ...]) -> IdentificationData:
    """The experiments that `cure_drift` keeps, positions and references without steps: the controller's law holds."""
    kept = long_enough(data)
    assert kept is not None
    level = without_steps(kept, list(steps))
    experiments = [
        _referred(item, item.outputs - before.outputs)
        for item, before in zip(level.experiments, kept.experiments, strict=True)
    ]
    return replace(level, experiments=tuple(experiments))


def _referred(item: Experiment, moved: NDArray[np.float64]) -> Experiment:
    """An experiment of which the outputs were moved, with references that are moved alike."""
    if item.reference is None or item.reference.shape != item.outputs.shape:
        return item
    return replace(item, reference=item.reference + moved)


def _levelled(
    item: Experiment, model: StateSpaceModel, gain: NDArray[np.float64], size: NDArray[np.float64]
) -> Experiment:
    moved = item.inputs.mean(axis=0) - model.input_offset
    by_drift = item.outputs.mean(axis=0) - model.output_offset - gain @ moved
    by_drift = np.where(np.abs(by_drift) <= _BEFORE * size, by_drift, 0.0)
    return _referred(replace(item, outputs=item.outputs - by_drift), -by_drift)


def _finding(data: IdentificationData, cure: DriftCure, size: NDArray[np.float64]) -> Finding:
    drifting = [
        (name, f"{value:.2g} {unit}".strip())
        for name, unit, value in zip(data.output_names, data.output_units, size, strict=True)
        if value
    ]
    return Finding(
        "drift",
        Severity.WARNING,
        f"slow drift by about {', '.join(text for _, text in drifting)} was removed from all signals "
        f"({cure.summary.removeprefix('drift removed: ')})",
        ", ".join(name for name, _ in drifting),
        f"below {cure.corner:.3g} Hz nothing is judged: record when the sensors have warmed up",
    )
