"""MATLAB and Octave files (version 5) of data.

`write_mat` writes the cells `u`, `y` and `r` with one matrix for each experiment, so that in MATLAB
`iddata(y, u, Ts, 'InputName', InputName, 'OutputName', OutputName)` has the same experiments. Cells `u` and
`y` of others are read too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from amb_core.data.experiments.dataset import IdentificationData
from amb_core.data.experiments.experiment import Experiment
from amb_core.ground.errors import IdentificationError
from amb_core.ground.files.matlab import cell, save_variables, texts

_NAMES = {
    "input_names": "InputName",
    "output_names": "OutputName",
    "input_units": "InputUnit",
    "output_units": "OutputUnit",
}
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
    save_variables(path, variables)


def data_of_variables(content: Mapping[str, Any], sample_time: float | None) -> IdentificationData | None:
    """The data of the variables of `write_mat`, or of cells u and y of others; None for other variables.

    Raises
    ------
    IdentificationError
        If u and y have different numbers of experiments, or the sample time (s) is neither in the file nor given.
    """
    if not {"u", "y"} <= set(content) or any(content[name].dtype != object for name in "uy"):
        return None
    written = "FirstStep" in content
    u, y = content["u"].ravel().tolist(), content["y"].ravel().tolist()
    if len(u) != len(y):
        raise IdentificationError(f"u has {len(u)} experiments, y has {len(y)}; the numbers must be equal")
    sample_time = float(content["Ts"].item()) if "Ts" in content else sample_time
    if sample_time is None:
        raise IdentificationError("the sample time is not known; give sample_time in s: --sample-time, --rate HZ")
    labels: dict[str, Any] = {name: texts(content[matlab]) for name, matlab in _NAMES.items() if matlab in content}
    experiments = []
    for index, (inputs, outputs) in enumerate(zip(u, y, strict=True)):
        trends = {name: content[matlab].ravel()[index] for name, matlab in _TRENDS.items() if matlab in content}
        reference = content["r"].ravel()[index] if "r" in content else np.empty(0)
        experiments.append(
            Experiment(
                inputs,
                outputs,
                reference if reference.size else None,
                int(content["FirstStep"].ravel()[index]) if written else 0,
                texts(content["Source"])[index] if written else f"experiment {index}",
                **trends,
            )
        )
    plain = IdentificationData.from_arrays(u[0], y[0], sample_time, **labels)
    return replace(plain, experiments=tuple(experiments), foreign=not written)
