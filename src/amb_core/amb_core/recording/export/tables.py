"""A run as a table in a file: CSV, Parquet or MATLAB, one row per step; missing steps have no row.

Rows are written batch after batch, so memory use does not depend on their number. All numbers come back bit for bit.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Collection, Mapping
from pathlib import Path

from amb_core.ground.extras import extra
from amb_core.recording.export.columns import ColumnName, column_names, column_values
from amb_core.recording.export.mat_columns import write_mat_columns
from amb_core.recording.export.run_telemetry import RunTelemetry

Beside = Mapping[str, float | str]


def write_table(
    telemetry: RunTelemetry, path: Path, signals: Collection[str] = (), beside: Beside | None = None
) -> None:
    """Write a run as `.csv`, `.parquet` or `.mat`, by the ending of the name.

    Parameters
    ----------
    telemetry : RunTelemetry
        The run.
    path : Path
        The file, which is written from its beginning.
    signals : collection of str, optional
        `reference`, `position` or `current`; by default all of them.
    beside : mapping of str to float or str, optional
        What else is known of the run, by name, with the unit of numbers as a text: variables of a MATLAB file, metadata
        of a Parquet file. A `.csv` has no place for it. None for nothing.

    Raises
    ------
    BagError
        If there is no such signal, or the bag cannot be read on.
    OSError
        If the file cannot be written.
    """
    names = column_names(telemetry.axes, signals)
    WRITERS[path.suffix.lower()](telemetry, path, names, signals, beside or {})


def _write_csv(
    telemetry: RunTelemetry, path: Path, names: list[ColumnName], signals: Collection[str], beside: Beside
) -> None:
    with extra("files"):
        import pyarrow as pa
        from pyarrow import csv as pa_csv

    schema = pa.schema([(name.heading, pa.float64()) for name in names])
    with path.open("wb") as file:
        heading = io.StringIO()
        csv.writer(heading, lineterminator="\n").writerow(name.heading for name in names)  # quoted where need be
        file.write(heading.getvalue().encode())
        with pa_csv.CSVWriter(file, schema, write_options=pa_csv.WriteOptions(include_header=False)) as writer:
            for record in telemetry.batches():
                writer.write_batch(pa.record_batch(list(column_values(record, signals)), schema=schema))


def _write_parquet(
    telemetry: RunTelemetry, path: Path, names: list[ColumnName], signals: Collection[str], beside: Beside
) -> None:
    with extra("files"):
        import pyarrow as pa
        from pyarrow import parquet

    schema = pa.schema(
        [pa.field(name.heading, pa.float64(), metadata={"unit": name.unit}) for name in names],
        metadata={
            "sample_time": repr(telemetry.sample_time),
            "run": str(telemetry.run),
            **{name: str(value) for name, value in beside.items()},
        },
    )
    with parquet.ParquetWriter(str(path), schema, compression="zstd") as writer:
        for record in telemetry.batches():
            writer.write_batch(pa.record_batch(list(column_values(record, signals)), schema=schema))


def _write_mat(
    telemetry: RunTelemetry, path: Path, names: list[ColumnName], signals: Collection[str], beside: Beside
) -> None:
    batches = (list(column_values(record, signals)) for record in telemetry.batches())
    texts = {"names": [name.name for name in names], "units": [name.unit for name in names]}
    texts |= {name: [value] for name, value in beside.items() if isinstance(value, str)}
    numbers = {"Ts": telemetry.sample_time, "run": float(telemetry.run)}
    numbers |= {name: value for name, value in beside.items() if not isinstance(value, str)}
    write_mat_columns(path, [name.name for name in names], telemetry.steps, batches, numbers, texts)


WRITERS: dict[str, Callable[[RunTelemetry, Path, list[ColumnName], Collection[str], Beside], None]] = {
    ".csv": _write_csv,
    ".parquet": _write_parquet,
    ".mat": _write_mat,
}
"""By the ending of the file's name."""
