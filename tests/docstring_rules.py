"""Rules of public docstrings, and what breaks them.

Demanded of every function, class, method and property that a package of amb_core exports (`__all__`), and the client:

- Parameters: every argument, with its type and a description; an array with its shape; a real number with its unit in
  parentheses, (-) for a pure number, or with the words `unit of` and whose; an argument with a default says so
  (`optional` or `default`), and what None means.
- Returns or Yields, with a description, unless nothing is returned; of an array its shape.
- Raises: every exception that leaves the function by its own code; of a class, those of its construction.

Fields of a parameter set are described where they are declared.
"""

from __future__ import annotations

import ast
import builtins
import dataclasses
import enum
import importlib
import inspect
import pkgutil
import re
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from types import GenericAlias, ModuleType, UnionType
from typing import Any

from pydantic import BaseModel

import amb_bringup.client
import amb_core

OURS = ("amb_core", "amb_bringup", "tests")
ARRAY = re.compile(r"\b(NDArray|ndarray|ArrayLike)\b")
NUMBER = re.compile(r"\b(float|complex|float64|complex128|ArrayLike)\b")
SHAPE = re.compile(r"shapes? \([^()]*\)(?:(?:, | and | or )+\([^()]*\))*")
UNIT_OF_ONE = (
    r"(?:-|1|%|percent|ppm|dB|rad|deg|Hz|kHz|um|mm|m|inch|s|ns|us|A|V|N|T|H|W|Wb|ohm|S|kg|K|deg C|Pa|J|"
    r"steps?|samples|bytes)"
)
UNIT = re.compile(
    rf"\({UNIT_OF_ONE}(?:\^-?\d)?(?:[ /]{UNIT_OF_ONE}(?:\^-?\d)?)*(?:, [^()]*)?\)|\bunits? of\b|\(its unit\)"
)


# -- what is public


def modules() -> list[ModuleType]:
    names = [module.name for module in pkgutil.walk_packages(amb_core.__path__, "amb_core.")]
    return [importlib.import_module(name) for name in names]


def rooms() -> list[ModuleType]:
    """The modules that list what they export."""
    return [*(module for module in modules() if hasattr(module, "__all__")), amb_bringup.client]


def public_objects(module: ModuleType) -> Iterator[tuple[str, Any]]:
    """Functions and classes by name that a module defines and makes public (`__all__`, or no underscore)."""
    for name in getattr(module, "__all__", [name for name in vars(module) if not name.startswith("_")]):
        item = getattr(module, name)
        item = getattr(item, "py_func", item)  # the Python function behind a compiled one
        own = hasattr(module, "__all__") or getattr(item, "__module__", "") == module.__name__
        if own and (inspect.isclass(item) or inspect.isfunction(item)):
            yield name, item


def members(cls: type) -> Iterator[tuple[str, Any, str, bool]]:
    """Public methods and properties of a class that are of our own code.

    Each with its name, function, docstring (its own, or that of the method which it overrides) and whether it is a
    property.
    """
    for name in dir(cls):
        ours = [vars(base)[name] for base in cls.__mro__ if name in vars(base) and base.__module__.startswith(OURS)]
        if name.startswith("_") or not ours or name in getattr(cls, "__dataclass_fields__", {}):
            continue  # not public, of another package, or the default of a field
        text = next((owner.__doc__ for owner in ours if getattr(owner, "__doc__", None)), "")
        getter = getattr(ours[0], "fget", None) or getattr(ours[0], "func", None)  # property, cached_property
        function = getter or getattr(ours[0], "__func__", ours[0])  # of a class method, static method
        if inspect.isfunction(function):
            yield name, function, text, getter is not None


# -- reading docstrings


@dataclasses.dataclass
class Entry:
    """What a section says of one name: its type, and the description."""

    type: str
    text: str = ""


def sections_of(text: str) -> dict[str, dict[str, Entry]]:
    """Entries of each section by name; those of Returns and Yields, which may lack one, by number."""
    parts = re.split(r"^(\w[\w ]*)\n-+$\n?", inspect.cleandoc(text), flags=re.MULTILINE)
    sections: dict[str, dict[str, Entry]] = {}
    for heading, body in zip(parts[1::2], parts[2::2], strict=True):
        entries: dict[str, Entry] = {}
        last = Entry("")
        for line in body.splitlines():
            if line.startswith(" "):
                last.text += " " + line.strip()
            elif line:
                names, _, kind = line.partition(" : ")
                last = Entry(kind)
                if heading in ("Returns", "Yields"):  # of a type, with or without a name
                    last = entries[str(len(entries))] = Entry(kind or names)
                else:
                    entries.update({name.lstrip("*"): last for name in names.split(", ")})
        sections[heading] = entries
    return sections


def raised_by(function: Callable[..., Any]) -> set[str]:
    """Names of the exceptions that leave a function by its own code: not those that it catches itself."""
    definition = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    assert isinstance(definition, ast.FunctionDef)
    return {kind.__name__ for kind in raised_in(definition.body, {**vars(builtins), **function.__globals__})}


def raised_in(nodes: Iterable[ast.AST], known: Mapping[str, Any]) -> set[type[BaseException]]:
    kinds: set[type[BaseException]] = set()
    for node in nodes:
        if isinstance(node, ast.Raise):
            kinds |= {kind} if (kind := kind_raised(node, known)) else set()
        elif isinstance(node, ast.Try):
            caught = tuple(kind for handler in node.handlers for kind in kinds_caught(handler, known))
            kinds |= {kind for kind in raised_in(node.body, known) if not issubclass(kind, caught)}
            kinds |= raised_in([*node.handlers, *node.orelse, *node.finalbody], known)
        elif not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            kinds |= raised_in(ast.iter_child_nodes(node), known)
    return kinds


def kind_raised(node: ast.Raise, known: Mapping[str, Any]) -> type[BaseException] | None:
    """The exception of a statement, also one that a function makes; None for one that is raised again."""
    made = node.exc.func if isinstance(node.exc, ast.Call) else node.exc
    kind = known.get(ast.unparse(made)) if made else None
    if inspect.isfunction(kind):
        name = str(kind.__annotations__.get("return", ""))
        kind = kind.__globals__.get(name, getattr(builtins, name, None))
    return kind if inspect.isclass(kind) and issubclass(kind, BaseException) else None


def kinds_caught(handler: ast.ExceptHandler, known: Mapping[str, Any]) -> list[type[BaseException]]:
    names = handler.type.elts if isinstance(handler.type, ast.Tuple) else [handler.type] if handler.type else []
    kinds = [known.get(ast.unparse(name)) for name in names]
    return [kind for kind in kinds if inspect.isclass(kind) and issubclass(kind, BaseException)]


# -- what is missing


def problems_of(function: Callable[..., Any], text: str | None, is_property: bool = False) -> list[str]:
    """What the docstring of a function, method or property lacks."""
    if not text:
        return ["no docstring"]
    sections, signature, known = sections_of(text), inspect.signature(function), function.__globals__
    problems = problems_of_errors(sections, raised_by(function))
    if is_property:
        array = ARRAY.search(spelled_out(signature.return_annotation, known))
        return problems + (["property: no shape"] if array and "shape" not in text else [])
    problems += problems_of_arguments(sections, own_parameters(signature), known)
    return problems + problems_of_result(sections, signature, known)


def problems_of_class(cls: type) -> dict[str, list[str]]:
    """What the docstrings of a class and of its public members lack, by name."""
    problems = {name: problems_of(item, text, is_property) for name, item, text, is_property in members(cls)}
    if not vars(cls).get("__doc__"):
        return {"": ["no docstring"], **problems}
    sections = sections_of_class(cls)
    source = Path(inspect.getfile(cls))  # what dataclasses and protocols generate is not of it
    builders = [vars(cls)[name] for name in ("__init__", "__post_init__") if name in vars(cls)]
    builders = [item for item in builders if inspect.isfunction(item) and Path(item.__code__.co_filename) == source]
    own = [problem for item in builders for problem in problems_of_errors(sections, raised_by(item))]
    if issubclass(cls, BaseModel):
        fields = cls.model_fields.items()
        own += [f"{name}: not described" for name, one in fields if not (one.description or is_set(one.annotation))]
    elif takes_arguments(cls):
        known = {name: value for base in reversed(cls.__mro__) for name, value in vars(module_of(base)).items()}
        own += problems_of_arguments(sections, own_parameters(inspect.signature(cls)), known)
    return {"": own, **problems}


def sections_of_class(cls: type) -> dict[str, dict[str, Entry]]:
    """Entries of the docstrings of a class and its bases, and of fields that are described where they are declared."""
    sections: dict[str, dict[str, Entry]] = {}
    for base in reversed([base for base in cls.__mro__ if base.__module__.startswith(OURS)]):
        for heading, entries in sections_of(vars(base).get("__doc__") or "").items():
            sections[heading] = {**sections.get(heading, {}), **entries}
    for field in dataclasses.fields(cls) if dataclasses.is_dataclass(cls) else ():
        if "meaning" in field.metadata:
            entry = Entry(str(field.type), f"{field.metadata['meaning']} ({field.metadata['unit']})")
            sections.setdefault("Attributes", {})[field.name] = entry
    return sections


def module_of(cls: type) -> ModuleType:
    return sys.modules[cls.__module__]


def spelled_out(hint: object, known: Mapping[str, Any]) -> str:
    """A type hint as text, with the names of other types in place of aliases such as `Arrays`."""

    def full(match: re.Match[str]) -> str:
        kind = known.get(match[0])
        return str(kind) if isinstance(kind, GenericAlias | UnionType) else match[0]

    return re.sub(r"\b[A-Z]\w*", full, str(hint))


def is_set(kind: Any) -> bool:
    """Whether a field holds a parameter set, which describes itself."""
    return inspect.isclass(kind) and issubclass(kind, BaseModel) and bool(vars(kind).get("__doc__"))


def takes_arguments(cls: type) -> bool:
    ours = next((base for base in cls.__mro__ if "__init__" in vars(base) or hasattr(base, "_fields")), object)
    return (
        ours.__module__.startswith(OURS) and not issubclass(cls, enum.Enum) and not getattr(cls, "_is_protocol", False)
    )


def own_parameters(signature: inspect.Signature) -> dict[str, inspect.Parameter]:
    return {name: item for name, item in signature.parameters.items() if name not in ("self", "cls")}


def problems_of_arguments(
    sections: Mapping[str, Mapping[str, Entry]], parameters: Mapping[str, inspect.Parameter], known: Mapping[str, Any]
) -> list[str]:
    given = sections.get("Parameters", {})
    described = {**sections.get("Attributes", {}), **given}  # fields of a result are its attributes
    problems = []
    for name, parameter in parameters.items():
        entry = described.get(name)
        if entry is None:
            problems.append(f"{name}: not described")
            continue
        hint, whole = spelled_out(parameter.annotation, known), f"{entry.type} {entry.text}"
        checks = {
            "no type or no description": not (entry.type and entry.text),
            "no shape": ARRAY.search(hint) and "shape" not in whole,
            "no unit": NUMBER.search(hint) and not UNIT.search(SHAPE.sub("", entry.text)),
            "has a default, not said": name in given
            and parameter.default is not parameter.empty
            and not re.search("optional|default", entry.type),
            "meaning of None not said": parameter.default is None
            and not re.search(r"default|None|without|otherwise", entry.text, re.IGNORECASE),
        }
        problems += [f"{name}: {problem}" for problem, holds in checks.items() if holds]
    return problems


def problems_of_result(
    sections: Mapping[str, Mapping[str, Entry]], signature: inspect.Signature, known: Mapping[str, Any]
) -> list[str]:
    hint = spelled_out(signature.return_annotation, known)
    if hint in ("None", "NoReturn", "Never"):
        return []
    entries = {**sections.get("Returns", {}), **sections.get("Yields", {})}
    if not entries:
        return ["Returns: missing"]
    problems = [] if all(entry.text for entry in entries.values()) else ["Returns: no description"]
    whole = " ".join(f"{entry.type} {entry.text}" for entry in entries.values())
    return [*problems, *(["Returns: no shape"] if ARRAY.search(hint) and "shape" not in whole else [])]


def kinds_of_errors() -> set[str]:
    """Names of all exceptions of the modules that are loaded."""
    names, todo = set(), [BaseException]
    while todo:
        kind = todo.pop()
        names.add(kind.__name__)
        todo += type.__subclasses__(kind)
    return names


def problems_of_errors(sections: Mapping[str, Mapping[str, Entry]], raised: set[str]) -> list[str]:
    entries = sections.get("Raises", {})
    unknown = sorted(set(entries) - kinds_of_errors())
    return [
        *(f"Raises: {name} missing" for name in sorted(raised - set(entries))),
        *(f"Raises: {name} is no exception" for name in unknown),
        *(f"Raises: {name} has no description" for name, entry in entries.items() if not entry.text),
    ]


def problems_of_room(room: ModuleType) -> list[str]:
    every = []
    for name, item in public_objects(room):
        if inspect.isclass(item):
            lacking = {f"{name}.{member}".rstrip("."): what for member, what in problems_of_class(item).items()}
        else:
            lacking = {name: problems_of(item, item.__doc__)}
        every += [f"{where}: {problem}" for where, problems in lacking.items() for problem in problems]
    return every


def unknown_names(item: Any) -> set[str]:
    """Arguments that a docstring describes and its function or class does not take."""
    described = sections_of(item.__doc__ or "").get("Parameters")
    return set(described) - set(inspect.signature(item).parameters) if described else set()
