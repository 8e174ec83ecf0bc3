"""Configurations with which the C target does not start: numbers that are none, keys that are short."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from amb_core.ground.errors import TargetError
from amb_core.rig.link import Limits, ReferenceTarget
from tests.target_rig import NONCE, Rig, library, machine


def start_with(change: Callable[[Any], None]) -> None:
    """Boot a target after a change of its configuration, behind the checks of Python."""
    target = ReferenceTarget(library(), machine(2), nonce=NONCE)
    change(target._config)
    target.reboot(NONCE)


def put(field: str, index: int, value: float) -> Callable[[Any], None]:
    return lambda config: getattr(config, field).__setitem__(index, value)


def number(axis: int, index: int, value: float) -> Callable[[Any], None]:
    return lambda config: config.axis[axis].number.__setitem__(index, value)


def attribute(name: str, value: float) -> Callable[[Any], None]:
    return lambda config: setattr(config, name, value)


@pytest.mark.parametrize(
    "change",
    [
        attribute("sample_rate", math.nan), attribute("sample_rate", math.inf), attribute("sample_rate", 0.0),
        *(put("limits", index, math.nan) for index in range(21)), put("limits", 0, 0.0), put("limits", 4, -1.0),
        put("limits", 0, math.inf),  # a control current
        put("limits", 15, 8e-6),  # a reference slew with which no landing ends within a minute
        *(put("gains", index, math.nan) for index in range(10)), put("gains", 0, math.inf), put("gains", 1, -1.0),
        *(number(1, index, math.nan) for index in range(2, 8)), number(0, 7, 0.0), number(0, 7, math.inf),
        number(1, 7, 300e-6),  # another clearance of the same bearing
        *(attribute("key_length", length) for length in (1, 15, 65)), attribute("waveform", 0),
        attribute("axes", 0), attribute("axes", 17), attribute("coils", 33),
    ],
)  # fmt: skip
def test_it_does_not_start(change: Callable[[Any], None]) -> None:
    with pytest.raises(TargetError, match="does not start"):
        start_with(change)


@pytest.mark.parametrize(
    "change", [put("limits", 11, math.inf), number(0, 0, math.nan), number(0, 1, math.nan), lambda config: None]
)
def test_a_limit_may_be_infinite_and_an_axial_position_unknown(change: Callable[[Any], None]) -> None:
    start_with(change)


@pytest.mark.parametrize("length", [15, 65])
def test_a_short_or_long_key_is_refused_without_showing_it(length: int) -> None:
    key = bytes(range(100, 100 + length))
    with pytest.raises(TargetError, match=f"the key has {length} bytes; allowed: 16 to 64") as refused:
        Rig(key=key)
    assert key.hex() not in str(refused.value)


def test_too_slow_a_reference_to_land_is_named() -> None:
    said = r"limits.reference_slew = 1e-06 m/s is not allowed; allowed: .* m/s or more, to cross its largest clearance"
    with pytest.raises(TargetError, match=said):
        ReferenceTarget(library(), machine(2), Limits(reference_slew=1e-6), nonce=NONCE)
