"""Optional parts: where a package of one is missing, one line names the extra that brings it.

The extras are those of `setup.py`. Modules that need one import its packages inside `with extra(NAME):`.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from amb_core.ground.errors import MissingExtraError


@contextlib.contextmanager
def extra(name: str, of: str = "amb_core") -> Iterator[None]:
    """Import the packages of an extra inside.

    Parameters
    ----------
    name : str
        The extra, such as "cluster".
    of : str, optional
        The distribution with this extra.

    Raises
    ------
    MissingExtraError
        If one of them is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as problem:
        raise MissingExtraError(
            f"the Python package '{problem.name}' is not installed; it belongs to the extra '{name}' of {of}: "
            f"pip install {problem.name}, or {of}[{name}] for all of the extra"
        ) from None
