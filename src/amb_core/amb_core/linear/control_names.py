"""Names of signals that python-control takes: it refuses dots, which it keeps for the names of systems."""

from __future__ import annotations

from collections.abc import Sequence


def control_names(names: Sequence[str]) -> list[str]:
    """The names with underscores for dots, and one more where a name would then occur twice.

    Parameters
    ----------
    names : sequence of str
        Names of signals, such as `rotor.x`.

    Returns
    -------
    list of str
        As many names; those without dots are as they were.
    """
    taken = {name for name in names if "." not in name}
    changed = []
    for name in names:
        if "." in name:
            name = name.replace(".", "_")
            while name in taken:
                name += "_"
            taken.add(name)
        changed.append(name)
    return changed
