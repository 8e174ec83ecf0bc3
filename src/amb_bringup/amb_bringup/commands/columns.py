"""Options of commands for the signals of data: entries of a Bode diagram."""

from __future__ import annotations

from typing import Annotated

import typer

EntriesOption = Annotated[
    str, typer.Option(help="Entries of the Bode diagram: diagonal, or such as i_x:x,i_y:x; by default all.")
]
