"""Options of commands for the signals of data: columns and sample time of a data file, entries of a Bode diagram."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from amb_core.errors import IdentificationError

InputsOption = Annotated[
    str,
    typer.Option(help="Columns of a data file that are inputs: names (.csv) or numbers from 0, such as 0-3 or 0,2."),
]
OutputsOption = Annotated[str, typer.Option(help="Columns of a data file that are outputs, likewise.")]
VariableOption = Annotated[str, typer.Option(help="Matrix of a .mat or .npz file whose columns are signals.")]
SampleTimeOption = Annotated[
    float | None, typer.Option(help="Sample time of a data file that does not contain it, in s.")
]

EntriesOption = Annotated[
    str, typer.Option(help="Entries of the Bode diagram: diagonal, or such as i_x:x,i_y:x; by default all.")
]


def columns_of(
    path: Path, inputs: str = "", outputs: str = "", variable: str = "", sample_time: float | None = None
) -> dict[str, Any]:
    """The given options as arguments of `read_data` for this file.

    Raises
    ------
    IdentificationError
        If a column of a .mat or .npz file is not a number.
    """
    options: dict[str, Any] = {}
    for name, text in (("inputs", inputs), ("outputs", outputs)):
        if text:
            options[name] = text.split(",") if path.suffix.lower() == ".csv" else _numbers(name, text)
    if variable:
        options["variable"] = variable
    if sample_time is not None:
        options["sample_time"] = sample_time
    return options


def _numbers(name: str, text: str) -> list[int]:
    """Column numbers of a text such as 0-3 or 0,2."""
    try:
        parts = [part.split("-") for part in text.split(",")]
        return [column for part in parts for column in range(int(part[0]), int(part[-1]) + 1)]
    except ValueError:
        raise IdentificationError(
            f"--{name} {text} is not allowed; it must be column numbers from 0, such as 0-3 or 0,2"
        ) from None
