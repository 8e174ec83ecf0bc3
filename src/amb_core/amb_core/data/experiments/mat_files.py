"""MATLAB and Octave files (version 5) of data.

`write_mat` writes the cells `u`, `y` and `r` with one matrix for each experiment, so that in MATLAB
`iddata(y, u, Ts, 'InputName', InputName, 'OutputName', OutputName)` has the same experiments.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from amb_core.data.experiments.dataset import IdentificationData
from amb_core.data.experiments.experiment import Experiment
from amb_core.data.tables.clearances import ROW, UNIT, clearance_row, clearances_of_row
from amb_core.ground.files.matlab import cell, save_variables, texts

_NAMES = {
    "input_names": "InputName",
    "output_names": "OutputName",
    "input_units": "InputUnit",
    "output_units": "OutputUnit",
}
_CLEARANCES = {ROW: "Clearance", UNIT: "ClearanceUnit"}
_TRENDS = {"input_trend": "InputTrend", "output_trend": "OutputTrend", "reference_trend": "ReferenceTrend"}


def write_mat(data: IdentificationData, path: str | Path) -> None:
    """Write data as a `.mat` file."""
    variables: dict[str, Any] = {
        "u": cell([item.inputs for item in data.experiments]),
        "y": cell([item.outputs for item in data.experiments]),
        "r": cell([np.empty((0, 0)) if item.reference is None else item.reference for item in data.experiments]),
        "Ts": data.sample_time,
        "FirstStep": np.array([item.first_step for item in data.experiments], dtype=np.float64),
        "Source": cell([item.source for item in data.experiments]),
    }
    variables |= {matlab: cell(list(getattr(data, name))) for name, matlab in _NAMES.items()}
    variables |= {matlab: cell([getattr(item, name) for item in data.experiments]) for name, matlab in _TRENDS.items()}
    clearance = clearance_row(data.output_names, data.clearance)
    save_variables(path, variables | {_CLEARANCES[name]: value for name, value in clearance.items()})


def data_of_variables(content: Mapping[str, Any]) -> IdentificationData | None:
    """The data of the variables of `write_mat`; None for other variables."""
    if not {"u", "y", "r", "Ts", "FirstStep", "Source"} <= set(content):
        return None
    u, y, r, steps = (content[name].ravel() for name in ("u", "y", "r", "FirstStep"))
    experiments = tuple(
        Experiment(
            u[index],
            y[index],
            r[index] if r[index].size else None,
            int(steps[index]),
            source,
            **{name: content[matlab].ravel()[index] for name, matlab in _TRENDS.items()},
        )
        for index, source in enumerate(texts(content["Source"]))
    )
    labels: dict[str, Any] = {name: tuple(texts(content[matlab])) for name, matlab in _NAMES.items()}
    fields = {name: content[matlab] for name, matlab in _CLEARANCES.items() if matlab in content}
    clearance = clearances_of_row(labels["output_names"], fields)
    return IdentificationData(experiments, float(content["Ts"].item()), **labels, clearance=clearance)
