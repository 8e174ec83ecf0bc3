"""Tables of parameters and excitations in Markdown, from the declarations."""

from __future__ import annotations

import re
from collections.abc import Callable

from amb_bringup.graph.node_parameters import PARAMETERS
from amb_core.excitation import KINDS, Excitation
from amb_core.ground.parameters import Declaration, Parameters, declarations, own_declarations

TABLE = re.compile(r"(<!-- parameters: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def parameter_table(parameters: type[Parameters]) -> str:
    """A row for each parameter: name, default, unit, allowed values, description, and whether it can be changed.

    In addition whether the paper states the default or another one, or it is assumed, where the declarations say so.
    """
    declared = list(own_declarations(parameters))
    sourced = any(item.source for item in declared)
    heads = ["name", "default", "unit", "allowed", "description", "change", *["default is"] * sourced]
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for item in declared:
        change = "runtime" if item.runtime else "read-only"
        cells = [f"`{item.name}`", _value(item.default), item.unit, _allowed(item), item.description, change]
        lines.append(f"| {' | '.join([*cells, *[item.source] * sourced])} |")
    return "\n".join(lines) + "\n"


def excitation_table(_: type[Parameters] = Excitation) -> str:
    """The kinds of excitation by field; empty where a kind does not have it."""
    names = list(dict.fromkeys(name for kind in KINDS.values() for name in kind.model_fields))
    lines = [f"| field | {' | '.join(KINDS)} |", "|---" * (len(KINDS) + 1) + "|"]
    for name in names:
        cells = [_field(kind, name) for kind in KINDS.values()]
        lines.append(f"| `{name}` | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


TABLES: dict[str, tuple[Callable[[type[Parameters]], str], type[Parameters]]] = {
    **{parameters.__name__: (parameter_table, parameters) for parameters in PARAMETERS.values()},
    "excitations": (excitation_table, Excitation),
}


def with_current_tables(text: str) -> str:
    """A README with its tables made anew."""

    def render(match: re.Match[str]) -> str:
        make, parameters = TABLES[match[2]]
        return match[1] + make(parameters) + match[3]

    return TABLE.sub(render, text)


def parameter_reference() -> str:
    """A section for each node, with the table of its parameters."""
    return "\n".join(f"## {node}\n\n{parameter_table(parameters)}" for node, parameters in PARAMETERS.items())


def _value(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _allowed(item: Declaration) -> str:
    if item.choices:
        return ", ".join(item.choices)
    if item.minimum is None or item.maximum is None:
        return item.allowed
    return " to ".join(f"{bound:d}" if item.type is int else f"{bound:g}" for bound in (item.minimum, item.maximum))


def _field(kind: type[Excitation], name: str) -> str:
    field = kind.model_fields.get(name)
    if field is None:
        return ""
    if field.is_required():
        return "required"
    unit = next(item.unit for item in declarations(kind) if item.name == name)
    return "none" if field.default == () else f"{_value(field.default)} {'' if unit == '-' else unit}".strip()
