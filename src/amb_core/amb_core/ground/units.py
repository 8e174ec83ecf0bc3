"""Factors from SI units, in which the library computes, to those that people read; and quantities as people type them.

A quantity is a number, in the unit of its declaration, or a number with that unit and an SI prefix: 10um, 1 kHz, 0.5s,
25%. Only numbers without a unit take a percent sign.
"""

from __future__ import annotations

import math
import re

from amb_core.ground.errors import ParameterError

UM = 1e6
"""Micrometres in a metre."""

PREFIXES = {"p": 1e-12, "n": 1e-9, "u": 1e-6, "µ": 1e-6, "μ": 1e-6, "m": 1e-3, "": 1.0, "k": 1e3, "M": 1e6, "G": 1e9}
"""SI prefixes; both signs for micro."""
PURE, PERCENT = "-", "percent"
"""Declared units of numbers without one, and of those in percent."""
_ALSO = {"m": {"cm": 1e-2}, "kg": {"g": 1e-3, "t": 1e3}, "rad": {"deg": math.pi / 180.0}, "s": {"min": 60.0}}
_PREFIXED = ("m", "s", "Hz", "A", "V", "N", "H", "T", "W", "ohm")
_TYPED = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*")


def quantity_of(text: str, unit: str) -> float:
    """The value of a typed quantity in its declared unit.

    Parameters
    ----------
    text : str
        A number, with or without a unit.
    unit : str
        The declared unit: `-` for none.

    Raises
    ------
    ParameterError
        If it is no number, or its unit is another one; the message shows which are understood.
    """
    match = _TYPED.fullmatch(text)
    known = units_of(unit)
    if match is None:
        raise ParameterError(f"'{text}' is not a number; allowed: {_allowed(unit)}")
    value, typed = float(match[1]), match[2]
    if typed and typed not in known:
        raise ParameterError(f"'{text}' has the unit '{typed}'; allowed: {_allowed(unit)}")
    value *= known.get(typed, 1.0)
    if not math.isfinite(value):
        raise ParameterError(f"'{text}' is too large; allowed: {_allowed(unit)}")
    # as the same number written without a prefix: 10um is 1e-5, not 9.999999999999999e-06
    return float(f"{value:.15g}")


def units_of(unit: str) -> dict[str, float]:
    """Units in which a quantity of a declared unit may be typed, with their factors."""
    if unit == PURE:
        return {"%": 0.01}
    if unit == PERCENT:
        return {"%": 1.0}
    prefixed = {f"{prefix}{unit}": factor for prefix, factor in PREFIXES.items()} if unit in _PREFIXED else {unit: 1.0}
    return prefixed | _ALSO.get(unit, {})


def _allowed(unit: str) -> str:
    if unit in (PURE, PERCENT):
        return f"a number{' in percent' if unit == PERCENT else ''}, or one with %, as 25%"
    examples = {"m": "10um, 0.4mm", "Hz": "250, 1kHz", "s": "0.5s, 20ms", "kg": "2.5, 800g"}.get(unit, f"2, 2{unit}")
    return f"a number in {unit}, or one with its unit, as {examples}"
