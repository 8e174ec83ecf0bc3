"""Variables of a .mat, .npz or .npy file as a table: vectors and matrices of one length become columns."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice, takewhile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.data.tables.clearances import clearances_in
from amb_core.data.tables.table import Column, Table, split_unit
from amb_core.ground.errors import IdentificationError
from amb_core.ground.files.limits import MOST_COLUMNS

SAMPLE_TIMES = ("ts", "dt", "sample_time", "sampletime", "t_s", "tsample", "delta_t")
SAMPLE_RATES = ("fs", "sample_rate", "samplerate", "rate", "f_s", "sampling_rate", "sampling_frequency")
_NAMES = ("names", "columns", "labels", "channels", "signal_names")
_UNITS = ("units", "unit")
_MOST_SIGNALS = 64  # rows of a matrix that may be signals


def table_of_variables(
    path: str, variables: Mapping[str, Any], variable: str = "", wanted: Sequence[str] = ()
) -> Table:
    """Make a table of the variables of a file.

    Parameters
    ----------
    path : str
        The file, for messages.
    variables : mapping
        From `flat`.
    variable : str, optional
        Matrix or struct; empty for the only one.
    wanted : sequence of str, optional
        Columns that are asked for: of variables of several lengths those with theirs are taken, otherwise the longest.

    Returns
    -------
    Table
        The columns.

    Raises
    ------
    IdentificationError
        If there is no variable of this name, none of numbers, or which of several lengths or sample times is meant is
        not known.
    """
    arrays = {name: value for name, value in variables.items() if _is_signal(value)}
    there = _shown(arrays) or "none"
    if variable:
        chosen = {name: value for name, value in arrays.items() if name == variable or name.startswith(f"{variable}.")}
        if not chosen:
            raise IdentificationError(f"has no matrix {variable}; its matrices: {there}; name one with --variable")
        arrays = chosen
    if not arrays:
        raise IdentificationError("has no matrix or vector of numbers; save the signals as such")
    rows = _rows(arrays, wanted)
    left_out = {name: value for name, value in arrays.items() if max(value.shape) != rows}
    arrays = {name: value for name, value in arrays.items() if name not in left_out}
    if any(re.fullmatch(r"[uyr](_?\d+)?", _last(name)) for name in left_out):
        raise IdentificationError(
            f"needs the name of one matrix (--variable): the lengths differ; its matrices: {there}"
        )
    beside = _nearest_first(variables, next(iter(arrays)))
    texts = {name.casefold(): variables[name] for name in beside if _is_texts(variables[name])}
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
    columns = _without_struct(_as_iddata(columns, texts))
    shown, clearance = _shown(left_out), clearances_in(variables)
    return Table(path, tuple(columns), _sample_time(variables, arrays), left_out=shown, clearance=clearance)


def _rows(arrays: Mapping[str, Any], wanted: Sequence[str]) -> int:
    """Number of samples: that of the arrays with wanted columns, else of the longest."""
    names = {column.partition("[")[0].casefold() for column in wanted}
    asked = {name: value for name, value in arrays.items() if names & {_label(name), _last(_label(name))}}
    lengths = {max(value.shape) for value in asked.values()}
    if len(lengths) > 1:
        raise IdentificationError(f"the named signals have different lengths: {_shown(asked)}")
    return lengths.pop() if lengths else max(max(value.shape) for value in arrays.values())


def _label(name: str) -> str:
    return split_unit(name)[0].casefold()


def _last(name: str) -> str:
    return name.rpartition(".")[2]


def _shown(arrays: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} {value.shape}" for name, value in arrays.items())


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


def flat(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Variables with the fields of structs as `struct.field`."""
    for name, value in content.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{prefix}{name}.")
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


def _nearest_first(names: Iterable[str], signal: str) -> list[str]:
    """Names of variables, those of the same struct as a signal first, then those above it, then all others."""
    struct = signal.split(".")[:-1]

    def distance(name: str) -> tuple[int, int]:
        other = name.split(".")[:-1]
        shared = takewhile(lambda pair: pair[0] == pair[1], zip(struct, other, strict=False))
        return -sum(1 for _ in shared), len(other)

    return sorted(names, key=distance)


def _sample_time(variables: Mapping[str, Any], signals: Iterable[str]) -> float | None:
    """Sample time (s) of a scalar such as Ts or fs, the nearest of each signal in their structs; None if there is none.

    Raises
    ------
    IdentificationError
        If those of the signals differ.
    """
    times = {name: time for name, value in variables.items() if (time := _period(name, value)) is not None}
    if not times:
        return None
    one_of_each_struct = {signal.rpartition(".")[0]: signal for signal in signals}.values()
    used = list(dict.fromkeys(_nearest_first(times, signal)[0] for signal in one_of_each_struct))
    first = times[used[0]]
    if any(abs(times[name] / first - 1.0) > 1e-6 for name in used):
        raise IdentificationError(
            f"the sample times of {', '.join(used)} differ: {', '.join(f'{times[name]:g}' for name in used)} s; name "
            "one struct or matrix with --variable"
        )
    return first


def _period(name: str, value: Any) -> float | None:
    """Sample time (s) by a scalar; None for another variable, or one that is not positive and finite."""
    if not (isinstance(value, np.ndarray) and value.dtype.kind in "fiu" and value.size == 1):
        return None
    number, word = float(value.ravel()[0]), name.rsplit(".", 1)[-1].casefold()
    if not 0.0 < number < math.inf or word not in (*SAMPLE_TIMES, *SAMPLE_RATES):
        return None
    seconds = number if word in SAMPLE_TIMES else 1.0 / number
    return seconds if seconds < math.inf else None
