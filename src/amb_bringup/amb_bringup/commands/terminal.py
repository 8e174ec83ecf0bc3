"""The terminal of commands: texts of others reach it without control characters, and markup in them is only text."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import typer
from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from amb_core.ground.plain_text import plain_text


class Terminal(Console):
    """A console for which a text is a text: colours come by `style` or `rich.text.Text`.

    Parameters
    ----------
    stderr : bool, optional
        Whether it writes to the standard error output.
    """

    def __init__(self, stderr: bool = False, **settings: Any) -> None:
        super().__init__(stderr=stderr, markup=False, emoji=False, **settings)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """What is shown of a text, table or bar; only rich itself controls the terminal."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(plain_text(segment.text), segment.style)


def say(text: object, err: bool = False) -> None:
    """Print a line as it is, but for control characters."""
    typer.echo(plain_text(text), err=err)
