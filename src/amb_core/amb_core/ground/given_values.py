"""Values that users give to Python calls: converted where they are what is asked for, one clear line where not."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Mapping
from numbers import Integral, Real
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import AmbError, bounded

LONGEST_SHOWN = 200  # characters


def refusal(name: str, value: object, allowed: str, error: type[AmbError] = AmbError) -> AmbError:
    """The error that a value is not allowed, as one line."""
    return error(f"{name} = {_shown(value)} is not allowed; allowed: {allowed}")


def kind_of(value: object) -> str:
    """The type of a value, and the shape of an array, for a message."""
    shape = getattr(value, "shape", None)
    return f"{type(value).__name__}{'' if shape is None else f' of shape {shape}'}"


def require_kind(
    name: str, value: object, kind: type | tuple[type, ...], allowed: str, error: type[AmbError] = AmbError
) -> None:
    """Raise AmbError, or `error`, for a value that is of none of these types."""
    if not isinstance(value, kind):
        raise error(f"{name}: {kind_of(value)} is not allowed; allowed: {allowed}")


def require_callable(name: str, value: object, error: type[AmbError] = AmbError) -> None:
    """Raise AmbError, or `error`, for a value that is neither None nor can be called."""
    if value is not None and not callable(value):
        raise error(f"{name}: {kind_of(value)} is not allowed; allowed: a function, or None")


def require_word(what: str, value: object, words: Collection[str], error: type[AmbError] = AmbError) -> None:
    """Raise AmbError, or `error`, for a value that is none of these words."""
    if not (isinstance(value, str) and value in words):
        raise error(f"unknown {what} {_shown(value)}; allowed: {', '.join(words)}")


def number(name: str, value: object, error: type[AmbError] = AmbError) -> float:
    """A number of Python or NumPy as a float; AmbError, or `error`, for anything else, texts and truth values too."""
    single = _of_python(value)
    try:
        if not isinstance(single, bool | np.timedelta64) and isinstance(single, Real):
            return float(single)
    except OverflowError:
        pass
    raise refusal(name, value, "a number", error)


def whole_number(name: str, value: object, error: type[AmbError] = AmbError) -> int:
    """A whole number of Python or NumPy as an int; AmbError, or `error`, for anything else, such as 3.0."""
    single = _of_python(value)
    if not isinstance(single, bool | np.timedelta64) and isinstance(single, Integral):
        return int(single)
    raise refusal(name, value, "a whole number", error)


def whole_numbers(name: str, values: object, error: type[AmbError] = AmbError) -> tuple[int, ...]:
    """Whole numbers in order as a tuple; AmbError, or `error`, for anything else, such as one number."""
    single = isinstance(values, str | bytes | Mapping) or (isinstance(values, np.ndarray) and values.ndim == 0)
    if isinstance(values, Iterable) and not single:
        return tuple(whole_number(name, value, error) for value in values)
    raise error(f"{name}: {kind_of(values)} is not allowed; allowed: several whole numbers")


def numbers(name: str, values: Any, error: type[AmbError] = AmbError) -> NDArray[np.float64]:
    """Real numbers as an array; NaN where they are masked or None.

    Raises
    ------
    AmbError
        Or `error`, if there is anything else: texts, times, complex numbers, rows of different lengths.
    """
    try:
        array: Any = np.asanyarray(values)
    except (ValueError, TypeError):  # rows of different lengths
        raise refusal(name, values, "an array of real numbers", error) from None
    objects = array.dtype.kind == "O" and all(map(_is_real, np.ma.getdata(array).flat))
    if array.ndim == 0 or not (objects or array.dtype.kind in "biuf"):
        what = f"an array of {array.dtype}" if array.ndim else type(values).__name__
        raise error(f"{name}: {what} is not allowed; allowed: an array of real numbers")
    return np.asarray(np.ma.filled(array.astype(np.float64), np.nan))


def texts(name: str, values: Any, error: type[AmbError] = AmbError) -> tuple[str, ...]:
    """Texts as a tuple, one text as one of them; AmbError, or `error`, for anything else."""
    if isinstance(values, str):
        return (str(values),)
    try:
        given = tuple(values)
    except TypeError:
        given = (None,)
    if not isinstance(values, Mapping) and all(isinstance(item, str) for item in given):
        return tuple(str(item) for item in given)
    raise refusal(name, values, "a text for each", error)


def path_of(name: str, value: object, error: type[AmbError] = AmbError) -> Path:
    """A path; AmbError, or `error`, for what is neither a text nor a path."""
    if isinstance(value, str) or (isinstance(value, os.PathLike) and isinstance(os.fspath(value), str)):
        return Path(value)
    raise refusal(name, value, "a path", error)


def _shown(value: object) -> str:
    return bounded(" ".join(repr(value).split()), LONGEST_SHOWN)


def _of_python(value: object) -> object:
    """A number of NumPy as that of Python; anything else, such as a masked one, as it is."""
    if isinstance(value, np.generic) or (type(value) is np.ndarray and value.ndim == 0):
        return value.item() if value.dtype.kind in "biuf" else value
    return value


def _is_real(value: object) -> bool:
    return value is None or (not isinstance(value, np.timedelta64) and isinstance(value, Real))
