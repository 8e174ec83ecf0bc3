"""How long work reports how far it is: one form of callback for all of the library."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, int, int | None], None]
"""Called now and then with the name of the stage, how many of its items are finished, and how many there are in all.

None stands for a number that is not known: then the stage has begun, and nothing more is reported of it.
"""


def unseen(_stage: str, _done: int, _total: int | None) -> None:
    """The progress that nobody looks at."""


def as_stage(stage: str, progress: Progress | None) -> Progress:
    """The progress of a part of some work, under the name that the whole gives to it.

    Parameters
    ----------
    stage : str
        Name of the part within the whole.
    progress : callable or None
        See `Progress`. None for no calls.

    Returns
    -------
    callable
        What to pass to the part.
    """
    if progress is None:
        return unseen
    return lambda _stage, done, total: progress(stage, done, total)
