"""One declaration of the options of data files for all commands, and the preview of what was understood."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer
from rich.console import Console
from rich.table import Table

from amb_bringup.commands.damaged_bags import warn_of_damage
from amb_bringup.commands.progress import working
from amb_core.data.analysis import read, read_recording
from amb_core.data.experiments import DataDescription, DescribedData, RecordedLoop
from amb_core.data.experiments.description import LISTS
from amb_core.data.experiments.proposal import UndescribedError
from amb_core.ground.errors import IdentificationError
from amb_core.ground.units import UM
from amb_core.recording import Recording

PANEL = "Data of a file"
_SHOWN = {"m": ("um", UM), "A": ("A", 1.0)}  # units of the preview
_NUMBERS = ("rate", "sample_time")


@dataclass(frozen=True)
class DataOptions:
    """The options of data files as a user gave them.

    Attributes
    ----------
    values : mapping
        Fields of `DataDescription`, without those that were not given.
    description : Path or None
        Saved description that the values change.
    save : Path or None
        Where the description is saved.
    """

    values: Mapping[str, Any]
    description: Path | None = None
    save: Path | None = None

    def resolve(self) -> DataDescription:
        """The saved description with the given values; IdentificationError if one is not allowed."""
        saved = DataDescription.of() if self.description is None else DataDescription.load(self.description)
        return saved.with_values(**self.values)

    def read(self, console: Console, path: Path, **chosen: Any) -> RecordedLoop:
        """Read a file or bag, warn of damage, and show what was understood of a file of others.

        Raises
        ------
        BagError, IdentificationError, ParameterError
            As for `amb_core.data.analysis.read`.
        """
        with working(console, f"reading {path}"), self._proposing():
            loop = read(path, self.description, **chosen, **self.values)
        self._show(console, path, loop.damage, loop.described)
        return loop

    def recording(self, console: Console, path: Path) -> tuple[Recording, DescribedData | None]:
        """A bag with telemetry, or a file as a recording of one run, and what was understood; errors as for `read`."""
        with working(console, f"reading {path}"), self._proposing():
            recording, described = read_recording(path, self.description, **self.values)
        self._show(console, path, recording.truncated, described)
        return recording, described

    def _show(self, console: Console, path: Path, damage: str, described: DescribedData | None) -> None:
        warn_of_damage(console, path, damage)
        if described is None:
            return
        show_preview(console, path, described)
        if self.save is not None:
            described.description.save(self.save)
            console.print(f"description: {self.save}; for the next file: --description {self.save}", highlight=False)

    @contextmanager
    def _proposing(self) -> Iterator[None]:
        """Save what an undescribed file may be, where a description is to be saved."""
        try:
            yield
        except UndescribedError as problem:
            if self.save is None or problem.proposal is None:
                raise
            problem.proposal.save(self.save)
            raise IdentificationError(
                f"{problem}; this proposal is in {self.save}: check it, then give --description {self.save}"
            ) from None

    @property
    def given(self) -> list[str]:
        """The options that were given, as a user writes them."""
        others = {"description": self.description, "save_description": self.save}
        names = [*self.values, *(name for name, value in others.items() if value is not None)]
        return [f"--{name.replace('_', '-')}" for name in names]


def read_shown(console: Console) -> Callable[[Path, DataDescription], RecordedLoop]:
    """`amb_core.data.analysis.read` that shows damage, and what was understood of a file of others."""

    def shown(path: Path, known: DataDescription) -> RecordedLoop:
        with working(console, f"reading {path}"):
            loop = read(path, known)
        warn_of_damage(console, path, loop.damage)
        if loop.described is not None:
            show_preview(console, path, loop.described)
        return loop

    return shown


def data_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options of data files; it gets them as one argument, `files`, of type `DataOptions`."""
    hints = get_type_hints(command, include_extras=True)
    own = [
        item.replace(annotation=hints.get(item.name, item.annotation), kind=inspect.Parameter.KEYWORD_ONLY)
        for item in inspect.signature(command).parameters.values()
        if item.name != "files"
    ]
    options = [_option(name) for name in DataDescription.model_fields]
    saved = [
        _path("description", "Saved description of such files; other options change it."),
        _path("save_description", "Write what was understood here (.yaml), for the next file of the same kind."),
    ]

    def run(**values: Any) -> None:
        given = {name: values.pop(name) for name in DataDescription.model_fields}
        files = DataOptions(
            {name: value for name, value in given.items() if value not in (None, "")},
            values.pop("description"),
            values.pop("save_description"),
        )
        command(files=files, **values)

    run.__name__, run.__doc__ = command.__name__, command.__doc__
    parameters = [*own, *options, *saved]
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {item.name: item.annotation for item in parameters}
    return run


def show_preview(console: Console, path: Path, described: DescribedData) -> None:
    """Show what was understood of a file: its signals with role, unit, rate and range, and what is doubtful."""
    table = Table("signal", "role", "unit", "scale", "samples", "rate (Hz)", "range", "missing", title=f"{path}")
    for column in table.columns[3:6]:
        column.justify = "right"
    for row in described.rows:
        unit, factor = _SHOWN.get(row.si_unit, (row.si_unit, 1.0))
        table.add_row(
            row.signal,
            row.role,
            row.unit or "unknown",
            f"{row.scale:g}",
            str(row.samples),
            f"{row.rate:.6g}",
            f"{factor * row.low:.4g} to {factor * row.high:.4g} {unit}".strip(),
            str(row.missing) if row.missing else "",
        )
    console.print(table)
    for note in described.notes:
        console.print(f"{note}", style="yellow", highlight=False, soft_wrap=True)


def _option(name: str) -> inspect.Parameter:
    field = DataDescription.model_fields[name]
    kind: Any = float | None if name in _NUMBERS else str
    metavar = "A,B,..." if name in LISTS else None
    option = typer.Option(help=field.description, rich_help_panel=PANEL, show_default=False, metavar=metavar)
    default = None if name in _NUMBERS else ""
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[kind, option])


def _path(name: str, help: str) -> inspect.Parameter:
    option = typer.Option(help=help, rich_help_panel=PANEL, show_default=False, dir_okay=False)
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=Annotated[Path | None, option]
    )
