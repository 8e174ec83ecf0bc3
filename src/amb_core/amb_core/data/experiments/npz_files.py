"""NumPy archives of data: one array for every field of the data and of its experiments.

Clearances are there where they are known. The fields of experiment k end in `_k`, as `inputs_0`, `first_step_0`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from amb_core.data.experiments.dataset import IdentificationData
from amb_core.data.experiments.experiment import Experiment
from amb_core.data.tables.clearances import clearance_row, clearances_of_row

_DATA_FIELDS = ("sample_time", "input_names", "output_names", "input_units", "output_units")
_EXPERIMENT_FIELDS = tuple(item.name for item in fields(Experiment))


def write_npz(data: IdentificationData, path: str | Path) -> None:
    """Write data as an `.npz` archive."""
    arrays = {name: np.asarray(getattr(data, name)) for name in _DATA_FIELDS}
    arrays |= {name: np.asarray(value) for name, value in clearance_row(data.output_names, data.clearance).items()}
    for index, item in enumerate(data.experiments):
        for name in _EXPERIMENT_FIELDS:
            value = getattr(item, name)
            if value is not None:
                arrays[f"{name}_{index}"] = np.asarray(value)
    with Path(path).open("wb") as file:
        np.savez(file, **arrays)  # type: ignore[arg-type]


def data_of_arrays(content: Mapping[str, Any]) -> IdentificationData | None:
    """The data of an archive of `write_npz`; None for another one."""
    if not {*_DATA_FIELDS, "inputs_0", "first_step_0", "source_0"} <= set(content):
        return None
    experiments = []
    for index in range(sum(name.startswith("inputs_") for name in content)):
        item = {name: content[f"{name}_{index}"] for name in _EXPERIMENT_FIELDS if f"{name}_{index}" in content}
        experiments.append(Experiment(**item | {"first_step": int(item["first_step"]), "source": str(item["source"])}))
    names = (tuple(content[name].tolist()) for name in _DATA_FIELDS[1:])
    clearance = clearances_of_row(content["output_names"].tolist(), content)
    return IdentificationData(tuple(experiments), float(content["sample_time"]), *names, clearance=clearance)
