"""Text files of data: a header with names and units such as `i_x [A]`, then one row for each sample.

They begin with a comment line in JSON for what the columns do not contain: sample time, roles, trends, clearances.
"""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import numpy as np

from amb_core.data.experiments.dataset import IdentificationData
from amb_core.data.experiments.experiment import Experiment
from amb_core.data.tables import Table
from amb_core.data.tables.clearances import clearance_row, clearances_of_row
from amb_core.data.tables.text import WRITTEN
from amb_core.ground.errors import IdentificationError

_LABELS = ("input_names", "output_names", "input_units", "output_units")
_TRENDS = ("input_trend", "output_trend", "reference_trend")


def write_csv(data: IdentificationData, path: str | Path) -> None:
    """Write data as a `.csv` file: experiment, time, inputs, outputs and, where it is known, the reference."""
    about = {
        "sample_time": data.sample_time,
        **{name: getattr(data, name) for name in _LABELS},
        **clearance_row(data.output_names, data.clearance),
        "experiments": [
            {
                "steps": item.steps,
                "first_step": item.first_step,
                "source": item.source,
                "reference": item.reference is not None,
                **{name: getattr(item, name).tolist() for name in _TRENDS},
            }
            for item in data.experiments
        ],
    }
    outputs = [*zip(data.output_names, data.output_units, strict=True)]
    labels = [*zip(data.input_names, data.input_units, strict=True), *outputs]
    with_reference = any(item.reference is not None for item in data.experiments)
    if with_reference:
        labels += [(f"r_{name}", unit) for name, unit in outputs]
    with Path(path).open("w", newline="", encoding="utf-8") as file:
        file.write(f"{WRITTEN}{json.dumps(about)}\n")
        writer = csv.writer(file)
        writer.writerow(["experiment", "time [s]", *(f"{name} [{unit}]" if unit else name for name, unit in labels)])
        for index, item in enumerate(data.experiments):
            unknown = [math.nan] * len(outputs) if with_reference and item.reference is None else []
            for time, row in zip(item.time(data.sample_time).tolist(), item.signals.tolist(), strict=True):
                writer.writerow([index, time, *row, *unknown])


def data_of_text(table: Table) -> IdentificationData | None:
    """The data of a text of `write_csv`, by the order of its columns; None for another text.

    Raises
    ------
    IdentificationError
        If samples are missing.
    """
    if (about := table.about) is None:
        return None
    signals = np.column_stack([column.values for column in table.columns])
    m, p = len(about["input_names"]), len(about["output_names"])
    experiments = []
    for index, item in enumerate(about["experiments"]):
        rows = signals[signals[:, 0] == index, 2:]
        if len(rows) != item["steps"]:
            raise IdentificationError(f"samples of experiment {index} are missing; the file is truncated")
        reference = rows[:, m + p :] if item["reference"] else None
        others = {name: item[name] for name in ("first_step", "source", *_TRENDS)}
        experiments.append(Experiment(rows[:, :m], rows[:, m : m + p], reference, **others))
    clearance = clearances_of_row(about["output_names"], about)
    labels = {name: about[name] for name in _LABELS}
    return IdentificationData(tuple(experiments), about["sample_time"], **labels, clearance=clearance)
