"""Lists of experiments in YAML: one entry for each, with its kind and the settings of its excitation.

- {kind: multisine, amplitude: 10um, duration: 4s}
- {name: fast sweep, kind: sweep, amplitude: 5um, duration: 2s, frequency_end: 1kHz}
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from amb_bringup.client.experiment import Experiment
from amb_core.excitation import KINDS, excitation_from_settings
from amb_core.ground.errors import AmbError, ExcitationError
from amb_core.ground.files.regular_files import read_text, shown
from amb_core.ground.parameters import Declaration, declarations
from amb_core.ground.units import quantity_of


def read_experiments(path: Path) -> list[Experiment]:
    """The experiments of a file; quantities may have units, as on the command line.

    Raises
    ------
    ExcitationError
        One line that names file and entry, if the file is no such list or an excitation is wrong.
    """
    where = f"list of experiments {shown(path)}"
    try:
        entries = yaml.safe_load(read_text(path))
    except OSError as problem:
        raise ExcitationError(f"{where}: cannot be read: {problem.strerror}") from None
    except yaml.YAMLError as problem:
        raise ExcitationError(f"{where}: cannot be read: {' '.join(str(problem).split())}") from None
    if not isinstance(entries, list) or not entries:
        raise ExcitationError(f"{where}: must be a list, one entry as '- kind: multisine' for each experiment")
    experiments = []
    for number, entry in enumerate(entries, 1):
        try:
            experiments.append(_experiment(entry, number))
        except AmbError as problem:
            raise ExcitationError(f"{where}, entry {number}: {problem}") from None
    for name, count in Counter(experiment.name for experiment in experiments).items():
        if count > 1:
            raise ExcitationError(f"{where}: the name '{name}' is given {count} times; give each experiment its own")
    return experiments


def _experiment(entry: Any, number: int) -> Experiment:
    if not isinstance(entry, Mapping) or "kind" not in entry:
        raise ExcitationError("must be a mapping with kind and settings, as {kind: multisine, amplitude: 10um}")
    kind = str(entry["kind"])
    if kind not in KINDS:
        raise ExcitationError(f"unknown kind of excitation {kind!r}; allowed: {', '.join(KINDS)}")
    declared = {item.name: item for item in declarations(KINDS[kind])}
    settings = {
        str(name): _value(value, declared.get(str(name)))
        for name, value in entry.items()
        if name not in ("kind", "name")
    }
    return Experiment(str(entry.get("name", f"{number} {kind}")), excitation_from_settings(kind, settings))


def _value(value: Any, declaration: Declaration | None) -> Any:
    """A setting, with quantities as numbers; what is not one is left to the check of the excitation."""
    if declaration is None or declaration.type in (str, bool):
        return value
    if isinstance(value, list):
        return [_value(item, declaration) for item in value]
    if not isinstance(value, str):
        return value
    number = quantity_of(value, declaration.unit)
    return int(number) if declaration.type is int and number.is_integer() else number
