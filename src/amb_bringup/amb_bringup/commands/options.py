"""Options of commands: those that several commands share, and those made from declared parameters."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any, get_type_hints

import typer

from amb_bringup.commands.inputs import parameter_file
from amb_core.ground.errors import ParameterError
from amb_core.ground.parameters import Declaration, Parameters, declarations
from amb_core.ground.units import quantity_of

ParamsOption = Annotated[Path | None, typer.Option(help="Parameter file of all nodes, instead of config/paper.yaml.")]

ChangeOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="Parameter with another value, as rotor.gravity=0, rotor.mass=8kg or controller.current_limit=10; may be "
        "repeated.",
        metavar="NAME=VALUE",
    ),
]

Command = Callable[..., None]
CHANGES = "changes"  # the option --set among the parameters of a command

QUANTITY = "NUMBER[UNIT]"
"""How the help shows what a `Quantity` takes."""


class Quantity:
    """The type of all options that take quantities: a number in the declared unit, or one with its unit, as 10um."""

    __name__ = "quantity"

    def __init__(self, unit: str) -> None:
        self._unit = unit

    def __call__(self, text: str | float) -> float:
        """The value in the declared unit."""
        try:
            return quantity_of(str(text), self._unit)
        except ParameterError as problem:
            raise typer.BadParameter(str(problem)) from None


def quantity_option(unit: str, help: str) -> Any:
    """An option that takes a quantity of a declared unit."""
    return typer.Option(help=help, parser=Quantity(unit), metavar=QUANTITY)


def with_changes(command: Command) -> Command:
    """Give a command that takes a parameter file, `params`, the option --set; it receives the path of a changed file.

    That file exists while the command runs. A command without `params`, or with the option, is returned as it is.
    """
    signature = inspect.signature(command)
    if "params" not in signature.parameters or CHANGES in signature.parameters:
        return command
    hints = get_type_hints(command, include_extras=True)
    without = _default_in_words(hints["params"])

    def run(**values: Any) -> None:
        changes, params = values.pop(CHANGES), values["params"]
        if not changes:
            command(**values)
            return
        from amb_bringup.graph.parameter_changes import changed_file  # imports all nodes

        if params is None and without:
            raise ParameterError(f"--set needs --params FILE here; without it there is {without}")

        base = parameter_file(params)
        with TemporaryDirectory(prefix="amb-") as folder:
            path = Path(folder) / base.name
            changed_file(base, changes, path)
            command(**values | {"params": path})

    own = [
        item.replace(annotation=hints[item.name], kind=inspect.Parameter.KEYWORD_ONLY)
        for item in signature.parameters.values()
    ]
    place = next(number for number, item in enumerate(own) if item.name == "params")
    option = inspect.Parameter(CHANGES, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=ChangeOption)
    own.insert(place + 1, option)
    run.__name__, run.__module__, run.__doc__ = command.__name__, command.__module__, command.__doc__
    run.__signature__ = inspect.Signature(own)  # type: ignore[attr-defined]
    run.__annotations__ = {item.name: item.annotation for item in own}
    return run


def _default_in_words(annotation: Any) -> str:
    """What a command uses without its parameter file, where that is no file."""
    for item in getattr(annotation, "__metadata__", ()):
        if isinstance(getattr(item, "show_default", None), str):
            return str(item.show_default)
    return ""


def declared_options(
    sets: Mapping[str, Iterable[type[Parameters]]],
    leave_out: Iterable[str] = (),
    defaults: Mapping[str, float] | None = None,
    notes: Mapping[str, str] | None = None,
) -> Callable[[Command], Command]:
    """Give a command an option for every parameter in some parameter sets.

    The command gets one argument for all of them, `given`: the values of those that the user gave, by name. Each set
    provides the values of the others.

    Parameters
    ----------
    sets : mapping
        The sets, by the title of their panel in the help. Parameters of the same name share one option.
    leave_out : iterable of str, optional
        Names without an option in this command.
    defaults : mapping, optional
        Default values of the command instead of those of the sets.
    notes : mapping, optional
        Text in the help instead of a default.
    """
    options: dict[str, inspect.Parameter] = {}
    for panel, models in sets.items():
        declared: dict[str, dict[str, Declaration]] = {}
        for model in models:
            for item in declarations(model):
                declared.setdefault(item.name, {})[getattr(model, "kind", "")] = item
        for name, by_kind in declared.items():
            if name not in leave_out:
                own = (defaults or {}).get(name)
                options[name] = _option(
                    by_kind, panel, (notes or {}).get(name, "" if own is None else f"by default {own:g}")
                )

    def decorate(command: Command) -> Command:
        hints = get_type_hints(command, include_extras=True)
        own = [
            item.replace(annotation=hints[item.name], kind=inspect.Parameter.KEYWORD_ONLY)
            for item in inspect.signature(command).parameters.values()
            if item.name != "given"
        ]

        def run(**values: Any) -> None:
            given = dict(defaults or {})
            given |= {name: values[name] for name in options if values[name] not in (None, [])}
            command(given=given, **{item.name: values[item.name] for item in own})

        arguments = [item for item in own if _is_argument(item)]
        parameters = [*arguments, *options.values(), *(item for item in own if item not in arguments)]
        run.__name__, run.__module__, run.__doc__ = command.__name__, command.__module__, command.__doc__
        run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        run.__annotations__ = {item.name: item.annotation for item in parameters}
        return run

    return decorate


def _is_argument(parameter: inspect.Parameter) -> bool:
    return any(
        isinstance(item, typer.models.ArgumentInfo) for item in getattr(parameter.annotation, "__metadata__", ())
    )


def _option(declared: Mapping[str, Declaration], panel: str, note: str) -> inspect.Parameter:
    """The option of a parameter as each kind of set declares it."""
    item = next(iter(declared.values()))
    kind: Any = item.type if item.type in (bool, int, float, str) else list[float]
    parsing: Any = {} if item.type in (bool, int, str) else {"parser": Quantity(item.unit), "metavar": QUANTITY}
    option = typer.Option(help=_help(declared, note), rich_help_panel=panel, show_default=False, **parsing)
    return inspect.Parameter(
        item.name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=Annotated[kind | None, option]
    )


def _help(declared: Mapping[str, Declaration], note: str) -> str:
    """Meaning, allowed values and default of a parameter; kind by kind where they differ."""
    meanings: dict[str, dict[str, str]] = {}
    for kind, item in declared.items():
        meanings.setdefault(_meaning(item), {})[kind] = note or _default(item)
    texts = []
    for meaning, defaults in meanings.items():
        kinds = f"{', '.join(defaults)}: " if len(meanings) > 1 else meaning[:1].upper()
        texts.append(kinds + (meaning if len(meanings) > 1 else meaning[1:]) + _joined(defaults))
    return "; ".join(texts) + "."


def _meaning(item: Declaration) -> str:
    text = item.description + ("" if item.unit == "-" else f" ({item.unit})")
    if item.choices and not all(word in item.description for word in item.choices):
        return f"{text}: {', '.join(item.choices[:-1])} or {item.choices[-1]}"
    if item.minimum is not None:
        return f"{text}, {item.allowed.removesuffix(f' {item.unit}')}"
    return text if item.type in (bool, str) else f"{text}, once for each"


def _default(item: Declaration) -> str:
    if item.default == "" or isinstance(item.default, bool) or not isinstance(item.default, str | int | float):
        return ""
    default = item.default if isinstance(item.default, str) else format(item.default, "g")
    return f"by default {default}" + (f" ({item.source})" if item.source else "")


def _joined(defaults: Mapping[str, str]) -> str:
    """The defaults of several kinds; without the kinds' names if all are equal."""
    kinds: dict[str, list[str]] = {}
    for kind, text in defaults.items():
        kinds.setdefault(text, []).append(kind)
    if len(kinds) == 1:
        return "".join(f", {text}" for text in kinds if text)
    return "".join(f", {text} ({', '.join(names)})" for text, names in kinds.items() if text)
