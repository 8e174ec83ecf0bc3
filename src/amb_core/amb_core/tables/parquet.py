"""Parquet files as tables: columns of numbers, booleans, times, and lists of fixed length."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from amb_core.errors import IdentificationError
from amb_core.extras import extra
from amb_core.files.regular_files import open_regular
from amb_core.tables.table import Column, Table, split_unit

_TICKS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def read_parquet_table(path: Path) -> Table:
    """Read a Parquet file.

    Raises
    ------
    IdentificationError
        If no column is of numbers.
    """
    with extra("files"):
        import pyarrow.parquet as parquet  # takes a while to import

    with open_regular(path) as file:
        content = parquet.read_table(file)
    columns = [column for name in content.column_names for column in _columns(content, name)]
    if not columns:
        raise IdentificationError(f"no column is of numbers; there are {', '.join(content.column_names) or 'none'}")
    return Table(str(path), tuple(columns), _sample_time(content.schema.metadata or {}))


def _sample_time(metadata: Mapping[bytes, bytes]) -> float | None:
    """Sample time (s) in the metadata of a file of `amb bag export`; None if there is none."""
    try:
        return float(metadata[b"sample_time"])
    except (KeyError, ValueError):
        return None


def _columns(content: Any, heading: str) -> Iterator[Column]:
    with extra("files"):
        import pyarrow as pa

    field, data = content.schema.field(heading), content.column(heading)
    name, unit = split_unit(heading)
    unit = (field.metadata or {}).get(b"unit", unit.encode()).decode(errors="replace")
    kind = field.type
    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
        ticks = data.cast(pa.int64()).to_numpy().astype(np.float64)
        yield Column(name, (ticks - ticks[0]) * _TICKS[kind.unit], "s")
    elif pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind):
        yield Column(name, np.asarray(data.to_numpy(zero_copy_only=False), dtype=np.float64), unit)
    elif pa.types.is_fixed_size_list(kind) and not pa.types.is_nested(kind.value_type):
        values = np.asarray(data.to_pylist(), dtype=np.float64)
        for index in range(kind.list_size):
            yield Column(f"{name}[{index}]", values[:, index], unit, source=name)
