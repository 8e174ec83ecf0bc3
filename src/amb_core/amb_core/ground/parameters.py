"""One declaration per parameter: typed, bounded, with unit and description.

A parameter is declared once, as a field of a `Parameters` class made with `quantity`, `choice` or `switch`. From that
declaration come the validation, the ROS parameter descriptors, the parameter files and the tables in the docs.
"""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar, cast, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator

from amb_core.ground.errors import AmbError, ParameterError, ParameterValueError, bounded
from amb_core.ground.files.parameter_files import ParameterFile, full_name, known_in

if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass
else:
    ModelMetaclass = type(BaseModel)

SIMULATOR = "simulator"
CLOSE = 0.85  # likeness, 0 to 1, from which a name is taken for another one misspelt
LONGEST_SHOWN = 200  # characters of a value in a message


class _OneMessage(ModelMetaclass):
    """Makes a set of its class: wrong values are one line, as of `validate`, where pydantic has several.

    A metaclass, because pydantic does not call it for a set within another, whose names then are complete.
    """

    def __call__(cls, *unnamed: Any, **values: Any) -> Any:  # noqa: N805
        if unnamed:
            raise ParameterValueError(
                f"{cls.__name__}: {type(unnamed[0]).__name__} without a name is not allowed; allowed: parameters by "
                f"name; those of a dict: {cls.__name__}(**values)"
            )
        try:
            return super().__call__(**values)
        except ValidationError as problem:
            raise ParameterValueError(_first_problem(cast(type[Parameters], cls), problem)) from problem


class Parameters(BaseModel, metaclass=_OneMessage):
    """Base of all parameter sets: frozen, validated once, no unknown names, no NaN."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @field_validator("*", mode="before")
    @classmethod
    def _numbers_in_range(cls, value: Any, info: ValidationInfo) -> Any:
        """Check the numbers of a list that `quantities` declares, and take any kind of array for it.

        No truth value is a number: pydantic takes it for 0 or 1.
        """
        field = cls.model_fields[str(info.field_name)]
        if isinstance(value, bool) and field.annotation in (float, int):
            raise ValueError("not a number")
        extra = field.json_schema_extra
        if not (isinstance(extra, dict) and "each" in extra):
            return value
        value = value.tolist() if hasattr(value, "tolist") else value
        if isinstance(value, list | tuple) and all(type(item) in (float, int) for item in value):
            minimum, maximum = cast(tuple[float, float], extra["each"])
            if all(minimum <= item <= maximum for item in value):  # not NaN
                return tuple(float(item) for item in value)
        raise ValueError("not such a list")


P = TypeVar("P", bound=Parameters)


def quantity(
    default: float,
    unit: str,
    description: str,
    minimum: float,
    maximum: float,
    *,
    runtime: bool = False,
    source: str = "",
) -> Any:
    """Declare a number with unit (`-` for none) and closed range.

    `runtime`: may be changed while a node runs. `source`: whether the paper states the default, as `stated: table 1`,
    or another one, as `against section 2.4`, or it is `assumed`; empty for a parameter that has nothing to do with the
    paper.
    """
    extra = {"unit": unit, "runtime": runtime, "source": source}
    return Field(default, ge=minimum, le=maximum, description=description, json_schema_extra=cast(Any, extra))


def required(unit: str, description: str, minimum: float, maximum: float) -> Any:
    """Declare a number that has no default, with its unit and closed range."""
    return Field(ge=minimum, le=maximum, description=description, json_schema_extra={"unit": unit})


def of_machine(
    default: float, unit: str, description: str, minimum: float, maximum: float, *, simulator_parameter: str
) -> Any:
    """Declare a number that the machine decides, such as its sample rate: no parameter of a node or of a file.

    A node takes it from the topic `machine`; a script takes it from the simulator's parameter of that dotted name.
    """
    extra = {"unit": unit, "runtime": False, "of_machine": simulator_parameter}
    return Field(default, ge=minimum, le=maximum, description=description, json_schema_extra=cast(Any, extra))


def quantities(
    unit: str, description: str, minimum: float, maximum: float, *, runtime: bool = False, source: str = ""
) -> Any:
    """Declare a list of numbers, by default empty, with the unit and the closed range of each."""
    extra = {"unit": unit, "runtime": runtime, "source": source, "each": (minimum, maximum)}
    return Field((), description=description, json_schema_extra=cast(Any, extra))


def switch(default: bool, description: str, *, runtime: bool = False, source: str = "") -> Any:
    """Declare an on/off parameter."""
    return Field(default, description=description, json_schema_extra={"runtime": runtime, "source": source})


def choice(default: str, description: str, *, runtime: bool = False, source: str = "") -> Any:
    """Declare a parameter whose type is a Literal of the allowed words, or free text where its type is str."""
    return Field(default, description=description, json_schema_extra={"runtime": runtime, "source": source})


@dataclass(frozen=True)
class Declaration:
    """One parameter as declared: dotted name, type, default, unit, description, range or choices.

    `of_machine` names the simulator's parameter that decides it; empty for a parameter of its own. `source`: whether
    the paper states the default (`stated: table 1`) or another one (`against section 2.4`), or it is `assumed`; empty
    if it has nothing to do with the paper.
    """

    name: str
    type: type
    default: Any
    unit: str
    description: str
    minimum: float | None
    maximum: float | None
    choices: tuple[str, ...]
    runtime: bool
    of_machine: str = ""
    source: str = ""

    @property
    def allowed(self) -> str:
        """What values are allowed, as text."""
        if self.choices:
            return "one of " + ", ".join(self.choices)
        if self.minimum is not None and self.maximum is not None:
            unit = "" if self.unit == "-" else f" {self.unit}"
            numbers = f"{self.minimum:g} to {self.maximum:g}{unit}"
            return f"a list of numbers from {numbers}" if self.type is tuple else numbers
        return {bool: "true or false", str: "text"}.get(self.type, self.type.__name__)


def declarations(model: type[Parameters], prefix: str = "") -> Iterator[Declaration]:
    """All parameters of a class in order, nested sets as dotted names."""
    for name, field in model.model_fields.items():
        annotation = field.annotation
        extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
        if isinstance(annotation, type) and issubclass(annotation, Parameters):
            yield from declarations(annotation, f"{prefix}{name}.")
            continue
        choices = get_args(annotation) if get_origin(annotation) is Literal else ()
        bounds = {key: getattr(item, key) for item in field.metadata for key in ("ge", "le") if hasattr(item, key)}
        if "each" in extra:
            bounds = dict(zip(("ge", "le"), cast(tuple[float, float], extra["each"]), strict=True))
        yield Declaration(
            name=prefix + name,
            type=str if choices else get_origin(annotation) or annotation,  # type: ignore[arg-type]
            default=field.get_default(call_default_factory=True),
            unit=str(extra.get("unit", "-")),
            description=field.description or "",
            minimum=bounds.get("ge"),
            maximum=bounds.get("le"),
            choices=tuple(str(word) for word in choices),
            runtime=bool(extra.get("runtime", False)),
            of_machine=str(extra.get("of_machine", "")),
            source=str(extra.get("source", "")),
        )


@dataclass(frozen=True)
class SourcedValue:
    """A value of a parameter set; `source` is that of the declaration's default, or `given` for any other value."""

    name: str
    value: Any
    unit: str
    source: str


def sourced_values(parameters: Parameters) -> Iterator[SourcedValue]:
    """The values of a set for which the paper states something, or has to."""
    values = flatten(parameters.model_dump())
    for item in declarations(type(parameters)):
        if item.source:
            value = values[item.name]
            source = item.source if value == item.default else "given"
            yield SourcedValue(item.name, value, item.unit, source)


def shown_value(value: Any) -> str:
    """A value for a table: numbers with six digits, switches as in parameter files."""
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, int | float) else str(value)


def own_declarations(model: type[Parameters]) -> Iterator[Declaration]:
    """The parameters of a class that a node declares and a parameter file may give."""
    return (declaration for declaration in declarations(model) if not declaration.of_machine)


def refuse_those_of_machine(model: type[Parameters], values: Mapping[str, Any]) -> None:
    """Raise ParameterError if a value is given, to a node or in its section of a file, that the machine decides."""
    for declaration in declarations(model):
        if declaration.of_machine and declaration.name in values:
            raise ParameterError(
                f"parameter '{declaration.name}' = {values[declaration.name]!r} is not allowed; the machine decides "
                f"it: give '{declaration.of_machine}' of the simulator alone"
            )


def flatten(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested mappings as one mapping with dotted names."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            flat.update(flatten(value, f"{prefix}{name}."))
        else:
            flat[prefix + str(name)] = value
    return flat


def validate(model: type[P], values: Mapping[str, Any], error: type[Exception] = ParameterError) -> P:
    """Make a parameter set from values by (dotted or nested) name; what is not given takes its default.

    Raises
    ------
    ParameterError
        (or `error`) One line naming the first wrong parameter, its value and what is allowed.
    """
    if not isinstance(values, Mapping):
        raise error(f"{model.__name__}: {type(values).__name__} is not allowed; allowed: values by name")
    flat = flatten(values)
    declared = {declaration.name: declaration for declaration in declarations(model)}
    for name in flat:
        if name not in declared:
            raise error(_unknown(name, flat[name], declared))
    try:
        return model.model_validate(nest(flat))
    except ValidationError as problem:
        raise error(_first_problem(model, problem)) from None


def given_set(model: type[P], name: str, given: P | None, error: type[AmbError] = ParameterError) -> P:
    """A parameter set that a caller gives: itself, or the defaults for None.

    Raises
    ------
    ParameterError
        (or `error`) If it is anything else, such as a dict of its values.
    """
    if given is None:
        return model()
    if isinstance(given, model):
        return given
    hint = f"; {model.__name__}(**values) makes one of a dict" if isinstance(given, Mapping) else ""
    raise error(f"{name}: {type(given).__name__} is not allowed; allowed: {model.__name__}{hint}")


def _first_problem(model: type[Parameters], problem: ValidationError) -> str:
    """The first wrong parameter, its value and what is allowed, as one line; unknown names first."""
    problems = problem.errors(include_url=False)
    first = next((one for one in problems if one["type"] == "extra_forbidden"), problems[0])
    declared = {declaration.name: declaration for declaration in declarations(model)}
    name = ".".join(str(part) for part in first["loc"])
    if first["type"] == "extra_forbidden":
        return _unknown(name, first["input"], declared)
    if name in declared:
        what = "is missing" if first["type"] == "missing" else f"= {_shown(first['input'])} is not allowed"
        return f"parameter '{name}' {what}; allowed: {declared[name].allowed}"
    if first["type"] == "model_type":
        allowed = f"{first['ctx']['class_name']}, or its parameters by name"
        return f"parameter set '{name}': {type(first['input']).__name__} is not allowed; allowed: {allowed}"
    reason = first["msg"].removeprefix("Value error, ")
    return f"parameter set '{name}': {reason}" if name else reason


def _shown(value: Any) -> str:
    return bounded(" ".join(repr(value).split()), LONGEST_SHOWN)


def part_of(model: type[P], values: Mapping[str, Any]) -> P:
    """A parameter set among all parameters of a node, by name: what the set does not declare is left out.

    Raises
    ------
    ParameterError
        If one of them is out of its range.
    """
    names = {declaration.name for declaration in declarations(model)}
    return validate(model, {name: value for name, value in flatten(values).items() if name in names})


def load_parameters(model: type[P], path: str | Path, node: str, *, part: bool = False) -> P:
    """Parameters of one node from a ROS parameter file, so that scripts without ROS use the same files as the nodes.

    Parameters
    ----------
    model : type[Parameters]
        The set.
    path : str or Path
        The file.
    node : str
        Full name of the node, or its name in the namespace of the graph.
    part : bool, optional
        Whether the set is only a part of the node's parameters: others in the file are left to the node.

    Raises
    ------
    ParameterError
        If the file cannot be read, is no parameter file, has a key that names no node of the graph, or holds a wrong
        parameter; the message names the file.
    """
    name = full_name(node)
    namespace = name.rsplit("/", 1)[0]
    file = ParameterFile(path, dict.fromkeys([name, *known_in(namespace)]))
    values = file.values(name)
    try:
        refuse_those_of_machine(model, values)
        if part:
            _refuse_misspelt(model, values)
        loaded = part_of(model, values) if part else validate(model, values)
        return _with_those_of_machine(loaded, file.values(f"{namespace}/{SIMULATOR}"))
    except ParameterError as problem:
        raise file.error(node, problem) from None


def _with_those_of_machine(loaded: P, simulator: Mapping[str, Any]) -> P:
    """The set with what the machine decides, by the simulator's parameters."""
    decided = {
        declaration.name: simulator[declaration.of_machine]
        for declaration in declarations(type(loaded))
        if declaration.of_machine and declaration.of_machine in simulator
    }
    return validate(type(loaded), {**flatten(loaded.model_dump()), **decided}) if decided else loaded


def _refuse_misspelt(model: type[P], values: Mapping[str, Any]) -> None:
    """Refuse what is meant for the set but not one of its names: it would be taken for another part's parameter."""
    names = [declaration.name for declaration in own_declarations(model)]
    groups = {name.rpartition(".")[0] for name in names} - {""}
    for name in values:
        if name not in names and (name.split(".")[0] in groups or difflib.get_close_matches(name, names, 1, CLOSE)):
            raise ParameterError(_unknown(name, values[name], names))


def _unknown(name: str, value: Any, known: Collection[str]) -> str:
    close = difflib.get_close_matches(name, known, n=1)
    hint = f"did you mean '{close[0]}'?" if close else "known: " + ", ".join(known)
    return f"unknown parameter '{name}' = {_shown(value)}; {hint}"


def nest(flat: Mapping[str, Any]) -> dict[str, Any]:
    """Dotted names as nested mappings: the inverse of `flatten`."""
    nested: dict[str, Any] = {}
    for name, value in flat.items():
        *groups, leaf = name.split(".")
        target = nested
        for group in groups:
            target = target.setdefault(group, {})
        target[leaf] = value
    return nested
