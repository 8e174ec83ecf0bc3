"""What the columns of a file are: given as options, saved as YAML, and used for the next file of the same rig."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import yaml
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from amb_core.ground.errors import IdentificationError, ParameterError
from amb_core.ground.files.file_errors import reading
from amb_core.ground.files.regular_files import read_text, shown
from amb_core.ground.units import quantity_of

Repair = Literal["none", "split", "resample"]
_CONTROLLER_FILES = (".yaml", ".yml", ".json", ".npz", ".mat")
LISTS = ("inputs", "outputs", "reference", "units", "topics")
"""Fields that are lists; as options, their items have commas between them."""


def _metres(given: Any) -> Any:
    """A length as a user types it, such as 250um, in m."""
    try:
        return quantity_of(given, "m") if isinstance(given, str) else given
    except ParameterError as problem:
        raise ValueError(str(problem)) from None


class DataDescription(BaseModel):
    """What is known of a file beside its content; empty fields are found in the file where it says so itself."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    inputs: tuple[str, ...] = Field(
        (),
        description="Columns that are inputs, such as i_x,i_y, numbers from 0, such as 0-3, or with another name for "
        "the model, such as i_x=cur_x_A.",
    )
    outputs: tuple[str, ...] = Field((), description="Columns that are outputs, likewise.")
    reference: tuple[str, ...] = Field((), description="Columns with the setpoint of each output, likewise.")
    time: str = Field("", description="Column of times; none to count samples at --rate.")
    units: tuple[str, ...] = Field(
        (), description="Units such as um,A, for every length and current without one, or of a column: x=mil,t=ms."
    )
    rate: float | None = Field(None, gt=0.0, le=1e9, description="Sample rate of a file without times, in Hz.")
    sample_time: float | None = Field(
        None, gt=0.0, le=1e6, description="Sample time of a data file that does not contain it, in s."
    )
    variable: str = Field("", description="Matrix or struct of a .mat or .npz file whose columns are signals.")
    topics: tuple[str, ...] = Field(
        (), description="Topics of a bag whose numbers are the columns, the first one timed."
    )
    controller: str = Field(
        "",
        description="Controller of the experiment: pd:K_P,K_D in A/m and A s/m with the derivative on the position "
        "error, pd:K_P,K_D,measurement with that on the measured position, a parameter file (.yaml), the file of a "
        "linear controller (.json, .npz, .mat), paper, or none for no closed loop; by default the one recorded.",
    )
    repair: Repair = Field(
        "none",
        description="What is done with missing samples and irregular times: none (refused), split (stretches between "
        "missing samples become experiments) or resample (times interpolated to one rate).",
    )
    clearance: Annotated[float | None, BeforeValidator(_metres)] = Field(
        None,
        ge=1e-6,
        le=1e-2,
        description="Displacement from the centre of the backup bearing at which the rotor touches it, such as 250um, "
        "in every radial bearing; positions must count from that centre. Without it region D is not judged.",
    )
    separator: str = Field("", description="Between the columns of a text: comma, semicolon, tab, bar or space.")
    decimal: str = Field("", description="Decimal sign of a text: point or comma.")

    @classmethod
    def of(cls, **values: Any) -> Self:
        """A description of checked values; a list may be a text with commas.

        Parameters
        ----------
        **values : object
            Fields by name.

        Returns
        -------
        DataDescription
            The description.

        Raises
        ------
        IdentificationError
            If a value is not allowed.
        """
        for name in LISTS:
            if isinstance(values.get(name), str):
                values[name] = tuple(part.strip() for part in values[name].split(",") if part.strip())
            elif values.get(name) is not None:
                values[name] = tuple(str(part) for part in values[name])
        try:
            return cls(**{name: value for name, value in values.items() if value is not None})
        except ValidationError as problem:
            first = problem.errors()[0]
            where = "_".join(str(part) for part in first["loc"][:1])
            if first["type"] == "extra_forbidden":
                text = f"'{where}' is not allowed; allowed: {', '.join(cls.model_fields)}"
            else:
                given = shown(repr(first["input"]))
                text = f"'{where}' = {given} is not allowed: {first['msg'][:1].lower()}{first['msg'][1:]}"
            raise IdentificationError(text) from None

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a description that `save` has written; the file of its controller is looked for beside it first.

        Parameters
        ----------
        path : str or Path
            YAML file.

        Returns
        -------
        DataDescription
            The description.

        Raises
        ------
        IdentificationError
            If it cannot be read, or a value is not allowed.
        """
        path = Path(path)
        with reading("description", path):
            known = cls._of_text(read_text(path))
        beside = path.parent / known.controller
        return known._with_controller(str(beside)) if known._names_a_file and beside.is_file() else known

    @classmethod
    def given(cls, text: str) -> Self:
        """A description as a request gives it: the path of a saved one (.yaml, .yml), or its content.

        Parameters
        ----------
        text : str
            Path that ends in .yaml or .yml, or YAML.

        Returns
        -------
        DataDescription
            The description.

        Raises
        ------
        IdentificationError
            If it cannot be read, or a value is not allowed.
        """
        if text.lower().endswith((".yaml", ".yml")):
            return cls.load(text)
        with reading("description", Path("in the request")):
            return cls._of_text(text)

    @classmethod
    def _of_text(cls, text: str) -> Self:
        content = yaml.safe_load(text) or {}
        if not isinstance(content, dict) or not all(isinstance(name, str) for name in content):
            raise IdentificationError("must have lines such as inputs: [i_x, i_y]")
        for name in LISTS:
            if isinstance(content.get(name), list) and any(isinstance(part, list | dict) for part in content[name]):
                raise IdentificationError(f"{name} must be a list of names")
        return cls.of(**content)

    def save(self, path: str | Path) -> None:
        """Write the fields that are given as YAML, the file of a controller as seen from the folder of this one.

        Parameters
        ----------
        path : str or Path
            File to write.

        Raises
        ------
        IdentificationError
            If the file cannot be written.
        """
        path, written = Path(path), self
        if self._names_a_file and not Path(self.controller).is_absolute() and Path(self.controller).is_file():
            written = self._with_controller(Path(os.path.relpath(self.controller, path.parent)).as_posix())
        try:
            path.write_text(written.text, encoding="utf-8")
        except OSError as problem:
            raise IdentificationError(f"description {path}: cannot be written: {problem.strerror}") from None

    def with_values(self, **values: Any) -> DataDescription:
        """The description with other values, checked; None and empty ones leave it as it is.

        Parameters
        ----------
        **values : object
            Fields by name; a new `rate` replaces a `sample_time`, and the other way round.

        Returns
        -------
        DataDescription
            The new description.
        """
        given = {name: value for name, value in values.items() if value not in (None, "", (), [])}
        if "rate" in given and "sample_time" not in given:
            given["sample_time"] = None
        elif "sample_time" in given and "rate" not in given:
            given["rate"] = None
        return type(self).of(**{**self.model_dump(), **given})

    def with_absolute_controller(self) -> DataDescription:
        """The description for a reader in another folder.

        Returns
        -------
        DataDescription
            The same, with the absolute path of the file of the controller, if it has one.
        """
        return self._with_controller(str(Path(self.controller).absolute())) if self._names_a_file else self

    @property
    def _names_a_file(self) -> bool:
        return self.controller.lower().endswith(_CONTROLLER_FILES)

    def _with_controller(self, controller: str) -> Self:
        return self.model_copy(update={"controller": controller})

    @property
    def text(self) -> str:
        """The fields that are given as YAML."""
        fields = self.model_dump(mode="json", exclude_defaults=True)
        return str(yaml.safe_dump(fields, sort_keys=False, allow_unicode=True))

    @property
    def columns(self) -> list[str]:
        """The columns that the description asks for."""
        signals = [column_of(item)[1] for item in (*self.inputs, *self.outputs, *self.reference)]
        return [name for name in (*signals, self.time) if name]

    @property
    def given_sample_time(self) -> float | None:
        """Sample time (s) by `rate` or `sample_time`; None if neither is given.

        Raises
        ------
        IdentificationError
            If both are given and differ.
        """
        if self.rate is None:
            return self.sample_time
        if self.sample_time is not None and abs(self.rate * self.sample_time - 1.0) > 1e-6:
            raise IdentificationError(
                f"--rate {self.rate:g} Hz and --sample-time {self.sample_time:g} s differ; give one of them"
            )
        return 1.0 / self.rate


def column_of(item: str) -> tuple[str, str]:
    """Name of a signal for the model and its column, from `i_x=cur_x_A`; the name is empty where none is given."""
    name, _, column = item.rpartition("=")
    return name.strip(), column.strip()
