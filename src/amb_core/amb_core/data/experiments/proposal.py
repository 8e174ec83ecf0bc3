"""What the columns of a file may be, by the words in their names and their units: proposed, never assumed."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass

from amb_core.data.experiments.description import DataDescription
from amb_core.data.tables import Column
from amb_core.data.tables.table import without_suffix
from amb_core.data.tables.units import CURRENTS, LENGTHS, spelled
from amb_core.ground.errors import IdentificationError

_WORDS = {
    "reference": {"r", "ref", "reference", "set", "setpoint", "sp", "target", "soll"},
    "inputs": {"i", "u", "cur", "curr", "current", "amp", "amps", "coil", "drive", "input", "strom", "courant"},
    "outputs": {"pos", "position", "disp", "displacement", "gap", "probe", "sensor", "output", "lage"},
}
_SI_ENDS = {"inputs": "_A", "outputs": "_m", "reference": "_m"}
_LETTERS = {"inputs": "i_", "outputs": "", "reference": "r_"}


class UndescribedError(IdentificationError):
    """Which columns are inputs and outputs is not known.

    Parameters
    ----------
    text : str
        The message.
    proposal : DataDescription or None
        What they may be, for a user to check.
    """

    def __init__(self, text: str, proposal: DataDescription | None = None) -> None:
        super().__init__(text)
        self.proposal = proposal


@dataclass(frozen=True)
class Proposal:
    """Fields of a description, as lists of their items."""

    given: dict[str, list[str]]

    @property
    def options(self) -> str:
        """As options of a command, quoted where a shell needs it."""
        return " ".join(f"--{name} {shlex.quote(','.join(items))}" for name, items in self.given.items())


def proposed(columns: Sequence[Column]) -> Proposal | None:
    """What columns may be; None if their names and units suggest no input or no output."""
    by_role: dict[str, list[tuple[Column, str, str]]] = {role: [] for role in ("inputs", "outputs", "reference")}
    for column in columns:
        words = [word for word in re.split(r"[^a-z0-9]+", without_si_end(column.name).casefold()) if word]
        unit = spelled(column.unit)
        role = next((role for role, known in _WORDS.items() if known & set(words)), "")
        role = role or ("inputs" if unit in CURRENTS else "outputs" if unit in LENGTHS else "")
        if role:
            axis = "_".join(word for word in words if word not in _WORDS[role])
            by_role[role].append((column, axis, unit or _SI_ENDS[role][1:] * column.name.endswith(_SI_ENDS[role])))
    if not by_role["inputs"] or not by_role["outputs"]:
        return None
    if len(by_role["reference"]) != len(by_role["outputs"]):
        del by_role["reference"]
    axes = [[axis for _, axis, _ in items] for items in by_role.values()]
    # names of a machine's axes only where every role has the same ones
    renamed = all(sorted(each) == sorted(axes[0]) for each in axes) and len({*axes[0], ""}) == len(axes[0]) + 1
    given = {
        role: [f"{_LETTERS[role]}{axis}={column.name}" if renamed else column.name for column, axis, _ in items]
        for role, items in by_role.items()
    }
    every = [(column.unit, unit) for items in by_role.values() for column, _, unit in items]
    units = {unit for _, unit in every}
    one_of_each = len(units) == 2 and units & set(CURRENTS) and units & set(LENGTHS)
    if one_of_each and any(not written for written, _ in every):
        given["units"] = sorted(units)
    return Proposal(given)


def without_si_end(name: str) -> str:
    """A name without the unit that it ends in, A and m included: `cur_x` for `cur_x_A`."""
    return re.sub(r"_(?:A|m)$", "", without_suffix(name))


def unit_at_end(columns: Sequence[Column], role: str) -> str:
    """The unit A of inputs or m of outputs where the names of all these columns end in it; empty otherwise."""
    end = _SI_ENDS["inputs" if role == "input" else "outputs"]
    return end[1:] if all((column.heading or column.name).endswith(end) for column in columns) else ""
