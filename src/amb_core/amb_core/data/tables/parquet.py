"""Parquet files as tables: columns of numbers, booleans, times, and lists of fixed length."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.data.tables.clearances import clearances_in
from amb_core.data.tables.table import Column, Table, split_unit
from amb_core.ground.errors import IdentificationError
from amb_core.ground.extras import extra
from amb_core.ground.files.apart import read_apart
from amb_core.ground.files.apart_server import seal
from amb_core.ground.files.limits import MOST_COLUMNS
from amb_core.ground.files.regular_files import open_regular

_TICKS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def read_parquet_table(path: Path) -> Table:
    """Read a Parquet file.

    Raises
    ------
    IdentificationError
        If no column is of numbers.
    """
    names, columns, sample_time, clearance = read_apart(
        f"{__name__}:columns_of_file", path, modules=("pyarrow.parquet",)
    )
    if not columns:
        raise IdentificationError(f"no column is of numbers; there are {', '.join(names) or 'none'}")
    return Table(str(path), tuple(Column(*column) for column in columns), sample_time, clearance=clearance)


def columns_of_file(
    path: str,
) -> tuple[list[str], list[tuple[str, NDArray[np.float64], str, str]], float | None, dict[str, float]]:
    """Names of all columns; name, values, unit and source of those of numbers; sample time (s); clearances (m)."""
    with extra("files"):
        import pyarrow.parquet as parquet  # takes a while to import

    with open_regular(path) as file:
        seal()
        whole = parquet.ParquetFile(file)
        if len(whole.schema) > MOST_COLUMNS:
            raise IdentificationError(f"has {len(whole.schema)} columns; allowed: at most {MOST_COLUMNS}")
        content = whole.read(use_threads=False)
    columns = [
        (column.name, column.values, column.unit, column.source)
        for name in content.column_names
        for column in _columns(content, name)
    ]
    metadata = content.schema.metadata or {}
    beside = {key.decode(errors="replace"): value.decode(errors="replace") for key, value in metadata.items()}
    return content.column_names, columns, _sample_time(metadata), clearances_in(beside)


def _sample_time(metadata: Mapping[bytes, bytes]) -> float | None:
    """Sample time (s) in the metadata of a file of `amb bag export`; None if there is none that is positive."""
    try:
        seconds = float(metadata[b"sample_time"])
    except (KeyError, ValueError):
        return None
    return seconds if 0.0 < seconds < math.inf else None


def _columns(content: Any, heading: str) -> Iterator[Column]:
    with extra("files"):
        import pyarrow as pa

    field, data = content.schema.field(heading), content.column(heading)
    name, unit = split_unit(heading)
    unit = (field.metadata or {}).get(b"unit", unit.encode()).decode(errors="replace")
    kind = field.type
    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
        yield Column(name, _TICKS[kind.unit] * _ticks(data.cast(pa.int64())), "s")
    elif pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind):
        yield Column(name, np.asarray(data.to_numpy(zero_copy_only=False), dtype=np.float64), unit)
    elif pa.types.is_fixed_size_list(kind) and not pa.types.is_nested(kind.value_type):
        values = np.asarray(data.to_pylist(), dtype=np.float64)
        for index in range(kind.list_size):
            yield Column(f"{name}[{index}]", values[:, index], unit, source=name)


def _ticks(data: Any) -> NDArray[np.float64]:
    """Integers less the first of them, NaN for missing ones: a double holds no ns of a date."""
    missing = data.is_null().to_numpy()
    ticks = data.fill_null(0).to_numpy()
    there = ticks[~missing]
    return np.where(missing, np.nan, ticks - (there[0] if there.size else 0))
