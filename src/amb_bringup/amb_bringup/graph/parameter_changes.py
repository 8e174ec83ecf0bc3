"""`--set NAME=VALUE`: a parameter file with other values of some parameters, checked as the nodes check them.

A name is one of the simulator (rotor.mass), `controller.` and one of the controller, or a node and one of its own
(region_monitor.drift_threshold). The values make a parameter file of their own, so that whatever reads a parameter
file, nodes included, needs to know nothing of them.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from amb_bringup.graph.node_parameters import PARAMETERS
from amb_core.ground.errors import ParameterError
from amb_core.ground.files.parameter_files import CONTROLLERS, ParameterFile
from amb_core.ground.parameters import SIMULATOR, Declaration, own_declarations, refuse_those_of_machine, validate
from amb_core.ground.units import quantity_of
from amb_core.plant.simulation.parameters import CONTROLLER

SWITCHES = {"true": True, "on": True, "yes": True, "1": True, "false": False, "off": False, "no": False, "0": False}
PROPOSED = 3
"""Names that are proposed instead of an unknown one."""


def changed_file(base: Path, changes: Iterable[str], out: Path) -> None:
    """Write a parameter file with changes.

    Parameters
    ----------
    base : Path
        The file without them.
    changes : iterable of str
        Each as NAME=VALUE; of two for the same name the later one counts.
    out : Path
        The file to write.

    Raises
    ------
    ParameterError
        One line, if the file is wrong, a name is unknown, or a value is of another type or out of its range.
    """
    file = ParameterFile(base)
    known = _known()
    values: dict[str, dict[str, Any]] = {}
    for change in changes:
        name, sign, text = change.partition("=")
        if not (name and sign and text):
            raise ParameterError(f"--set {change}: must be a name and its value, as controller.current_limit=10")
        if name not in known:
            raise ParameterError(f"--set {change}: {_unknown(name, known)}")
        node, declaration = known[name]
        try:
            values.setdefault(node, {})[declaration.name] = _typed(text, declaration)
        except ParameterError as problem:
            raise ParameterError(f"--set {change}: {problem}") from None
    for node, changed in values.items():
        present = file.values(node)
        try:
            refuse_those_of_machine(PARAMETERS[node], changed)
            validate(PARAMETERS[node], present | changed)
        except ParameterError as problem:
            raise ParameterError(f"--set: node {node}: {problem}") from None
    out.write_text(file.with_values(values))


def _known() -> dict[str, tuple[str, Declaration]]:
    """All names, with the node and the declaration that each stands for."""
    known = {
        f"{node}.{declaration.name}": (node, declaration)
        for node, model in PARAMETERS.items()
        for declaration in own_declarations(model)
    }
    for node, prefix in ((SIMULATOR, ""), *((node, CONTROLLER) for node in CONTROLLERS)):
        for declaration in own_declarations(PARAMETERS[node]):
            known.setdefault(prefix + declaration.name, (node, declaration))
    return known


def _unknown(name: str, known: Iterable[str]) -> str:
    """The nearest names, those with the same last word first."""
    names = list(known)
    last = name.rsplit(".", 1)[-1]
    same = [other for other in names if other.rsplit(".", 1)[-1] == last]
    short = {other.rsplit(".", 1)[-1]: other for other in reversed(names)}
    close = [
        *sorted(same, key=len),
        *difflib.get_close_matches(name, names, PROPOSED),
        *(short[word] for word in difflib.get_close_matches(last, short, PROPOSED)),
    ]
    proposed = list(dict.fromkeys(close))[:PROPOSED]
    hint = f"did you mean {', '.join(proposed)}?" if proposed else "amb plant describe and the READMEs list the names"
    return f"there is no parameter '{name}'; {hint}"


def _typed(text: str, declaration: Declaration) -> Any:
    """The value as the declaration takes it."""
    if declaration.type is str:
        return text
    if declaration.type is bool:
        if text.lower() not in SWITCHES:
            raise ParameterError(f"'{text}' is not a switch; allowed: true or false")
        return SWITCHES[text.lower()]
    if declaration.type is tuple:
        if not (text.startswith("[") and text.endswith("]")):
            raise ParameterError(f"'{text}' is not a list; allowed: {declaration.allowed}, as [1, 2]")
        return [quantity_of(word, declaration.unit) for word in text[1:-1].split(",") if word.strip()]
    number = quantity_of(text, declaration.unit)
    if declaration.type is not int:
        return number
    if not number.is_integer():
        raise ParameterError(f"'{text}' is not a whole number; allowed: {declaration.allowed}")
    return int(number)
