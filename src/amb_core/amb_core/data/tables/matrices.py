"""Variables of a .mat, .npz or .npy file as a table: vectors and matrices of one length become columns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.data.tables.table import Column, Table, split_unit
from amb_core.ground.errors import IdentificationError
from amb_core.ground.files.limits import MOST_COLUMNS

SAMPLE_TIMES = ("ts", "dt", "sample_time", "sampletime", "t_s", "tsample", "delta_t")
SAMPLE_RATES = ("fs", "sample_rate", "samplerate", "rate", "f_s", "sampling_rate", "sampling_frequency")
_NAMES = ("names", "columns", "labels", "channels", "signal_names")
_UNITS = ("units", "unit")
_MOST_SIGNALS = 64  # rows of a matrix that may be signals


def table_of_variables(path: str, content: Mapping[str, Any], variable: str = "") -> Table:
    """Make a table of the variables of a file.

    Raises
    ------
    IdentificationError
        If there is no variable of this name, none of numbers, or which of several lengths is meant is not known.
    """
    flat = dict(_flat(content))
    arrays = {name: value for name, value in flat.items() if _is_signal(value)}
    there = ", ".join(f"{name} {value.shape}" for name, value in arrays.items()) or "none"
    if variable:
        chosen = {name: value for name, value in arrays.items() if name == variable or name.startswith(f"{variable}.")}
        if not chosen:
            raise IdentificationError(f"has no matrix {variable}; its matrices: {there}; name one with --variable")
        arrays = chosen
    if not arrays:
        raise IdentificationError("has no matrix or vector of numbers; save the signals as such")
    lengths = {max(value.shape) for value in arrays.values()}
    if len(lengths) > 1:
        raise IdentificationError(
            f"needs the name of one matrix (--variable): the lengths differ; its matrices: {there}"
        )
    rows = lengths.pop()
    texts = {name.casefold(): value for name, value in flat.items() if _is_texts(value)}
    names, units = (_texts_of(texts, known) for known in (_NAMES, _UNITS))
    every = (column for name, value in arrays.items() for column in _columns(name, value, rows, len(arrays) == 1))
    columns = list(islice(every, MOST_COLUMNS + 1))
    if len(columns) > MOST_COLUMNS:
        raise IdentificationError(f"has more than {MOST_COLUMNS} signals; name one matrix with --variable")
    if len(names) == len(columns):
        labels = [split_unit(name) for name in names]
        if len(units) == len(columns):
            labels = [(name, unit) for (name, _), unit in zip(labels, units, strict=True)]
        columns = [
            Column(name, column.values, unit, column.source)
            for column, (name, unit) in zip(columns, labels, strict=True)
        ]
    return Table(path, tuple(_without_struct(_as_iddata(columns, texts))), _sample_time(flat))


def _as_iddata(columns: list[Column], texts: Mapping[str, Any]) -> list[Column]:
    """Columns of u, y and r with the names and units that MATLAB's iddata keeps beside them."""
    labelled = list(columns)
    for letter, kind in (("u", "input"), ("y", "output"), ("r", "output")):
        places = [index for index, column in enumerate(columns) if column.source.rpartition(".")[2] == letter]
        names, units = (_texts_of(texts, (f"{kind}{what}",)) for what in ("name", "unit"))
        for number, index in enumerate(places):
            column = columns[index]
            if len(names) == len(places):
                name = f"r_{names[number]}" if letter == "r" else names[number]
                column = replace(column, name=name, named=True)
            if len(units) == len(places):
                column = replace(column, unit=units[number])
            labelled[index] = column
    return labelled


def _without_struct(columns: list[Column]) -> list[Column]:
    """The columns of one struct by the names of its fields."""
    structs = {column.name.rpartition(".")[0] for column in columns}
    if len(structs) > 1 or structs == {""}:
        return columns
    return [replace(column, name=column.name.rpartition(".")[2]) for column in columns]


def _flat(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Variables with the fields of structs as `struct.field`."""
    for name, value in content.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


def _is_signal(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind in "fiub" and value.ndim in (1, 2) and value.size > 1


def _is_texts(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind in "UO" and value.size > 0


def _texts_of(texts: Mapping[str, Any], names: tuple[str, ...]) -> list[str]:
    value = next((value for name, value in texts.items() if name.rsplit(".", 1)[-1] in names), None)
    if value is None:
        return []
    return ["".join(np.asarray(item).ravel().astype(str).tolist()).strip() for item in value.ravel().tolist()]


def _columns(name: str, value: NDArray[Any], rows: int, only: bool) -> Iterator[Column]:
    matrix = np.asarray(value, dtype=np.float64)
    if matrix.ndim == 1:
        matrix = matrix[:, np.newaxis]
    elif matrix.shape[0] != rows and matrix.shape[0] <= _MOST_SIGNALS:  # signals in rows
        matrix = matrix.T
    if matrix.shape[1] == 1:
        yield Column(*_reordered(name, matrix[:, 0]), source=name)
        return
    for index in range(matrix.shape[1]):
        yield Column(f"{name}[{index}]", matrix[:, index], source="" if only else name, named=False)


def _reordered(name: str, values: NDArray[np.float64]) -> tuple[str, NDArray[np.float64], str]:
    label, unit = split_unit(name)
    return label, values, unit


def _sample_time(flat: Mapping[str, Any]) -> float | None:
    """Sample time (s) of a scalar such as Ts or fs; None if there is none."""
    for name, value in flat.items():
        if not (isinstance(value, np.ndarray) and value.dtype.kind in "fiu" and value.size == 1):
            continue
        number, word = float(value.ravel()[0]), name.rsplit(".", 1)[-1].casefold()
        if word in SAMPLE_TIMES and number > 0.0:
            return number
        if word in SAMPLE_RATES and number > 0.0:
            return 1.0 / number
    return None
