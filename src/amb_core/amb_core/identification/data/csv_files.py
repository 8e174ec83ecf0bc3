"""Text files of data: a header with names and units such as `i_x [A]`, then one row for each sample.

Files of `write_csv` begin with a comment line in JSON for what the columns do not contain: sample time, roles, trends.
Other files need the names of the columns that are inputs and outputs, and a column of times or the sample time.
"""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.errors import IdentificationError
from amb_core.files.apart import read_apart
from amb_core.files.file_errors import reading
from amb_core.files.limits import LONGEST_LINE
from amb_core.files.regular_files import open_regular
from amb_core.identification.data.dataset import IdentificationData
from amb_core.identification.data.described.clock import clock_of
from amb_core.identification.data.experiment import Experiment
from amb_core.identification.data.matrix_data import needed_sample_time

_COMMENT = "# amb_core "
_HEADER = re.compile(r"^\s*(?P<name>.*?)\s*(?:\[(?P<unit>[^\]]*)\])?\s*$")
_LABELS = ("input_names", "output_names", "input_units", "output_units")
_TRENDS = ("input_trend", "output_trend", "reference_trend")
_TIME_NAMES = ("time", "t")
_TIME_UNITS = {"": 1.0, "s": 1.0, "ms": 1e-3, "us": 1e-6}


def write_csv(data: IdentificationData, path: str | Path) -> None:
    """Write data as a `.csv` file: experiment, time, inputs, outputs and, where it is known, the reference."""
    about = {
        "sample_time": data.sample_time,
        **{name: getattr(data, name) for name in _LABELS},
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
        file.write(f"{_COMMENT}{json.dumps(about)}\n")
        writer = csv.writer(file)
        writer.writerow(["experiment", "time [s]", *(f"{name} [{unit}]" if unit else name for name, unit in labels)])
        for index, item in enumerate(data.experiments):
            unknown = [math.nan] * len(outputs) if with_reference and item.reference is None else []
            for time, row in zip(item.time(data.sample_time).tolist(), item.signals.tolist(), strict=True):
                writer.writerow([index, time, *row, *unknown])


def read_csv(
    path: str | Path,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    reference: Sequence[str] | None = None,
    sample_time: float | None = None,
) -> IdentificationData:
    """Read a file of `write_csv`, or any table with a header.

    Parameters
    ----------
    path : path
        The file; columns are separated by commas, semicolons or tabs.
    inputs, outputs, reference : sequence of str, optional
        Names of their columns, without units.
    sample_time : float, optional
        Sample time (s); by default that of the column `time` or `t`, in s, ms or us. If both are present they must
        agree. Missing times split the samples into experiments.

    Raises
    ------
    IdentificationError
        If the file cannot be read, a column is missing or contains no numbers, or the times are irregular.
    """
    path = Path(path)
    with reading("data", path):
        about, header, table = _read_table(path)
        if about is not None and inputs is None and outputs is None:
            return _own(about, table)
        if not inputs or not outputs:
            raise IdentificationError(
                "which columns are inputs and which outputs is not known; give inputs and outputs; "
                f"there are {', '.join(name for name, _ in header)}"
            )
        return _chosen(header, table, inputs, outputs, reference, sample_time, str(path))


def _read_table(path: Path) -> tuple[dict[str, Any] | None, list[tuple[str, str]], NDArray[np.float64]]:
    """Content of the comment, names and units of the columns, and the numbers, shape (rows, columns)."""
    about, header, table = read_apart(f"{__name__}:table_of_file", path)
    return about, [(name, unit) for name, unit in header], table


def table_of_file(path: str) -> tuple[dict[str, Any] | None, list[tuple[str, str]], NDArray[np.float64]]:
    """As `_read_table`, in this process."""
    # Spreadsheets begin with a byte order mark.
    with io.TextIOWrapper(open_regular(path), encoding="utf-8-sig", newline="") as file:
        line = file.readline(LONGEST_LINE)
        about = json.loads(line.removeprefix(_COMMENT)) if line.startswith(_COMMENT) else None
        while line.startswith("#"):
            line = file.readline()
        delimiter = max(",;\t", key=line.count)
        cells = next(csv.reader([line], delimiter=delimiter), [])
        rows = file.readlines()
    header = [(found["name"], found["unit"] or "") for found in map(_HEADER.match, cells) if found]
    if not header or (about is None and any(_is_number(name) for name, _ in header)):
        raise IdentificationError("the first line must have the names of the columns, such as i_x [A]")
    if not rows:
        raise IdentificationError("there are no samples, only a header")
    table = np.loadtxt(rows, delimiter=delimiter, ndmin=2, dtype=np.float64)
    if table.shape[1] != len(header):
        raise IdentificationError(f"the header has {len(header)} columns, the rows have {table.shape[1]}")
    return about, header, table


def _own(about: dict[str, Any], table: NDArray[np.float64]) -> IdentificationData:
    """The data of a file of `write_csv`, by the order of its columns."""
    m, p = len(about["input_names"]), len(about["output_names"])
    experiments = []
    for index, item in enumerate(about["experiments"]):
        rows = table[table[:, 0] == index, 2:]
        if len(rows) != item.pop("steps"):
            raise IdentificationError(f"samples of experiment {index} are missing; the file is truncated")
        reference = rows[:, m + p :] if item["reference"] else None
        experiments.append(
            Experiment(**item | {"inputs": rows[:, :m], "outputs": rows[:, m : m + p], "reference": reference})
        )
    return IdentificationData(tuple(experiments), about["sample_time"], **{name: about[name] for name in _LABELS})


def _chosen(
    header: list[tuple[str, str]],
    table: NDArray[np.float64],
    inputs: Sequence[str],
    outputs: Sequence[str],
    reference: Sequence[str] | None,
    sample_time: float | None,
    source: str,
) -> IdentificationData:
    """The data of named columns."""
    ins, outs, refs = ([_column(name, header) for name in names] for names in (inputs, outputs, reference or ()))
    spans = [(0, len(table), 0)]
    time = next((column for column, (name, _) in enumerate(header) if name.lower() in _TIME_NAMES), None)
    if time is not None:
        unit = header[time][1]
        if unit not in _TIME_UNITS:
            raise IdentificationError(f"times are in {unit}; allowed: s, ms, us")
        clock = clock_of(table[:, time] * _TIME_UNITS[unit], sample_time)
        sample_time, spans = clock.sample_time, clock.spans
    experiments = tuple(
        Experiment(
            table[start:stop, ins],
            table[start:stop, outs],
            table[start:stop, refs] if refs else None,
            first_step,
            source,
        )
        for start, stop, first_step in spans
    )
    return IdentificationData(
        experiments,
        needed_sample_time(sample_time),
        tuple(inputs),
        tuple(outputs),
        tuple(header[column][1] for column in ins),
        tuple(header[column][1] for column in outs),
    )


def _column(name: str, header: list[tuple[str, str]]) -> int:
    names = [known for known, _ in header]
    if names.count(name) != 1:
        raise IdentificationError(f"there must be one column {name!r}; there are {', '.join(names)}")
    return names.index(name)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
