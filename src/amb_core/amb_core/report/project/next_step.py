"""The command that comes next in a project: the first step of the work whose result is missing or stale."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from amb_core.report.project.items import Item, Kind, State


@dataclass(frozen=True)
class NextStep:
    """A command to type, empty if there is none, and why.

    Attributes
    ----------
    command : str
        The command, to be typed in the project's folder.
    reason : str
        What is missing or stale.
    """

    command: str
    reason: str


def next_step(items: Sequence[Item]) -> NextStep:
    """The next command for judged items."""
    bearings = [item for item in items if item.kind is Kind.BEARING]
    if not bearings:
        return NextStep("amb new bearing.yaml", "there is no parameter file of a bearing")
    params = f"--params {_word(bearings[0].path)}"
    maps = _current(items, Kind.MAP)
    if not maps:
        return NextStep(f"amb map {params}", _why(items, Kind.MAP))
    designs = _current(items, Kind.DESIGN)
    if not designs:
        where = f"--map {_word(maps[0].path)} {params}"
        return NextStep(f"amb excitation design multisine {where}", _why(items, Kind.DESIGN))
    experiments = _current(items, Kind.EXPERIMENT)
    if len(experiments) < 2:
        name, seed = ("validation", " --seed 2") if experiments else ("estimation", "")
        wanted = _free(name, items)
        why = "a second experiment, for the validation, is missing" if experiments else _why(items, Kind.EXPERIMENT)
        design = _word(designs[0].path.parent)
        return NextStep(f"amb experiment --design {design}{seed} {params} --record {wanted} --no-report", why)
    models = _current(items, Kind.MODEL)
    if not models:
        first = next((item for item in experiments if item.path.name.startswith("estimation")), experiments[0])
        return NextStep(f"amb identify {_word(first.path)} --out results/model", _why(items, Kind.MODEL))
    certificates = sorted(_current(items, Kind.CERTIFICATE), key=_rank)
    if not certificates:
        used = [item for item in experiments if str(item.path) in models[0].inputs]
        other = [item for item in experiments if item not in used]
        bags = "".join(f" --bag {_word(item.path)}" for item in used[:1])
        bags += "".join(f" --validation-bag {_word(item.path)}" for item in other[:1])
        return NextStep(f"amb certify {_word(models[0].path)}{bags}", _why(items, Kind.CERTIFICATE))
    needed = [bearings[0], maps[0], designs[0], *experiments[:2], models[0], certificates[0]]
    return NextStep("", _outcome(needed, certificates[0]))


def _rank(certificate: Item) -> tuple[bool, bool]:
    """For sorting: current ones first, of these the ones that certify."""
    return certificate.state is not State.CURRENT, not _certifies(certificate)


def _certifies(certificate: Item) -> bool:
    return certificate.content.get("certified") is True


def _outcome(needed: Sequence[Item], certificate: Item) -> str:
    """What the work has come to where no step is missing."""
    unknown = [str(item.path) for item in needed if item.state is State.UNKNOWN]
    known = f"; not known to be current: {', '.join(unknown)}" if unknown else " and current"
    statement = certificate.content.get("statement", "not certified")
    states = "" if _certifies(certificate) else f"; the certificate states: {statement}"
    return f"everything is there{known}{states}"


def _current(items: Sequence[Item], kind: Kind) -> list[Item]:
    """Those that are not stale, first those that are known to be current."""
    there = [item for item in items if item.kind is kind and item.state is not State.STALE]
    return sorted(there, key=lambda item: item.state is not State.CURRENT)


def _why(items: Sequence[Item], kind: Kind) -> str:
    others = [item for item in items if item.kind is kind]
    return f"{others[0].path} is {others[0].state}: {others[0].reason}" if others else f"there is no {kind}"


def _free(name: str, items: Sequence[Item]) -> str:
    """A name for a new bag."""
    taken = {str(item.path) for item in items}
    return next(wanted for number in range(1, len(taken) + 2)
                if (wanted := name if number == 1 else f"{name}_{number}") not in taken)  # fmt: skip


def _word(path: Path) -> str:
    return shlex.quote(str(path))
