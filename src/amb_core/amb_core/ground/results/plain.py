"""Results as plain values for strict JSON: the one way from a result to a file or a message.

Values are in SI units and in full. Names of percentages end in `_percent`, except `fit`; those of decibels
end in `_db`. A number that does not exist is None.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import PurePath
from typing import Any

VERSION = 2
"""Version of the names and units of files of results; they begin with it. Before there was none."""


def plain(value: Any) -> Any:
    """A value as JSON has it.

    Parameters
    ----------
    value : object
        Numbers, texts, None, arrays, enumerations (their names), paths, dataclasses, parameters, and mappings and
        sequences of these. A complex number becomes [real, imaginary]; NaN and infinity become None.

    Returns
    -------
    object
        The JSON value.

    Raises
    ------
    TypeError
        If a part is something else.
    """
    if isinstance(value, Mapping):
        return {str(plain(name)): plain(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    if hasattr(value, "tolist"):  # NumPy's, which is not imported for this
        return plain(value.tolist())
    if is_dataclass(value):
        return {item.name: plain(getattr(value, item.name)) for item in fields(value)}
    return plain(value.model_dump()) if hasattr(value, "model_dump") else _scalar(value)


def _scalar(value: Any) -> Any:
    if isinstance(value, Enum) and not isinstance(value, str):
        return value.name
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, complex):
        return [_scalar(value.real), _scalar(value.imag)]
    if isinstance(value, PurePath):
        return str(value)
    raise TypeError(f"{type(value).__name__} is not a plain value")
