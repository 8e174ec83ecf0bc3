"""Public docstrings are complete: arguments with shapes and units, what is returned, and the errors that are raised."""

from __future__ import annotations

import dataclasses
import inspect
import re
from types import ModuleType

import numpy as np
import pytest
from numpy.typing import NDArray

from amb_core.ground.errors import ParameterError
from tests.docstring_rules import (
    modules,
    problems_of,
    problems_of_class,
    problems_of_room,
    public_objects,
    raised_by,
    rooms,
    sections_of,
    unknown_names,
)


@pytest.mark.parametrize("room", rooms(), ids=lambda room: room.__name__)
def test_docstrings_of_exported_names_are_complete(room: ModuleType) -> None:
    problems = problems_of_room(room)
    assert not problems, "\n".join(problems)


# -- all public names, exported or not


@pytest.mark.parametrize("module", modules(), ids=lambda module: module.__name__)
def test_public_names_have_docstrings_that_fit_their_signature(module: ModuleType) -> None:
    for name, item in public_objects(module):
        assert item.__doc__, f"{name} has no docstring"
        assert not unknown_names(item), f"{name} describes arguments that it does not take: {unknown_names(item)}"
        headings = re.findall(r"^(Parameters|Attributes|Returns|Yields|Raises)$", inspect.cleandoc(item.__doc__), re.M)
        assert set(headings) <= set(sections_of(item.__doc__)), f"{name}: a heading of {headings} is not underlined"


def test_exported_names_exist() -> None:
    for module in modules():
        for name in getattr(module, "__all__", []):
            assert hasattr(module, name), f"{module.__name__} exports {name}, which it lacks"


# -- the rules find what they are for

Arrays = NDArray[np.float64]


def in_order(signal: Arrays, limit: float, name: str = "x", most: float | None = None) -> Arrays:
    """A function whose docstring lacks nothing.

    Parameters
    ----------
    signal : ndarray, shape (steps, axes)
        Samples (m).
    limit : float
        Largest one (m).
    name : str, optional
        Name for messages.
    most : float, optional
        Largest slope (m/s); None for any.

    Returns
    -------
    ndarray, shape (steps, axes)
        The limited samples (m).

    Raises
    ------
    ParameterError
        If the limit is negative.
    """
    if limit < 0.0:
        raise ParameterError(f"{name} = {limit} is not allowed; allowed: 0 or more")
    return np.clip(signal, -limit, limit)


FAULTS = {
    "signal: not described": ("signal : ndarray, shape (steps, axes)\n        Samples (m).\n    ", ""),
    "signal: no shape": ("signal : ndarray, shape (steps, axes)", "signal : ndarray"),
    "signal: no unit": ("Samples (m).", "Samples."),
    "limit: no unit": ("Largest one (m).", "Largest one."),
    "limit: no type or no description": ("limit : float", "limit"),
    "name: has a default, not said": ("name : str, optional", "name : str"),
    "most: meaning of None not said": ("; None for any", ""),
    "Returns: no description": ("        The limited samples (m).\n", ""),
    "Returns: no shape": ("ndarray, shape (steps, axes)\n        The", "ndarray\n        The"),
    "Returns: missing": ("Returns\n    -------", "Results\n    -------"),
    "Raises: ParameterError missing": ("ParameterError\n", "ValueError\n"),
    "Raises: ParameterErr is no exception": ("ParameterError\n", "ParameterErr\n"),
    "Raises: ParameterError has no description": ("        If the limit is negative.\n", ""),
}


def test_a_complete_docstring_has_no_problem() -> None:
    assert problems_of(in_order, in_order.__doc__) == []


@pytest.mark.parametrize("fault", FAULTS)
def test_an_incomplete_docstring_is_refused(fault: str) -> None:
    right, wrong = FAULTS[fault]
    text = str(in_order.__doc__)
    assert right in text
    assert fault in problems_of(in_order, text.replace(right, wrong))


def test_a_unit_is_not_mistaken_for_a_shape() -> None:
    text = str(in_order.__doc__).replace("Samples (m).", "Samples of shape (steps, m).")
    assert "signal: no unit" in problems_of(in_order, text)


@dataclasses.dataclass(frozen=True)
class Span:
    """A part of a record.

    Attributes
    ----------
    first : int
        First step.
    """

    first: int
    length: float

    def __post_init__(self) -> None:
        if self.first < 0:
            raise ParameterError(f"first = {self.first} is not allowed; allowed: 0 or more")

    def holds(self, step: int) -> bool:
        """Whether a step belongs to it."""
        return step >= self.first

    @property
    def last(self) -> float:
        """Its end."""
        raise NotImplementedError


def test_fields_construction_methods_and_properties_of_a_class_are_looked_at() -> None:
    assert problems_of_class(Span) == {
        "": ["Raises: ParameterError missing", "length: not described"],
        "holds": ["step: not described", "Returns: missing"],
        "last": ["Raises: NotImplementedError missing"],
    }


def test_an_error_that_a_function_catches_itself_needs_no_description() -> None:
    def catches(text: str) -> float:
        try:
            if not text:
                raise ValueError("empty")
            return float(text)
        except ValueError:
            raise ParameterError(f"{text!r} is no number") from None

    assert raised_by(catches) == {"ParameterError"}
