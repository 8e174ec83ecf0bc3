"""Quantities as people type them: numbers in the declared unit, or with a unit of their own."""

from __future__ import annotations

import pytest

from amb_core.ground.errors import ParameterError
from amb_core.ground.units import quantity_of


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("10um", "m", 1e-5),
        ("10 µm", "m", 1e-5),
        ("0.4mm", "m", 4e-4),
        ("5m", "m", 5.0),
        ("4e-4", "m", 4e-4),
        ("1kHz", "Hz", 1000.0),
        ("0.5s", "s", 0.5),
        ("20ms", "s", 0.02),
        ("25%", "-", 0.25),
        ("25%", "percent", 25.0),
        ("800g", "kg", 0.8),
        ("-3", "A", -3.0),
        ("2 A s/m", "A s/m", 2.0),
    ],
)
def test_a_typed_quantity_has_the_value_of_its_declared_unit(text: str, unit: str, value: float) -> None:
    assert quantity_of(text, unit) == value


@pytest.mark.parametrize(("text", "unit"), [("10kHz", "m"), ("10u", "m"), ("ten", "m"), ("1e400", "m"), ("5%", "m")])
def test_another_unit_is_refused_with_what_is_understood(text: str, unit: str) -> None:
    with pytest.raises(ParameterError, match=r"allowed: a number in m, or one with its unit, as 10um, 0\.4mm"):
        quantity_of(text, unit)
