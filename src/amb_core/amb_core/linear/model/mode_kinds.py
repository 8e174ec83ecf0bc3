"""Names of the modes of a rotor in two bearings, where they can be decided from rates and mode shapes.

A rigid rotor in two radial bearings has four degrees of freedom: the slowest eight states of those that matter, two
for each complex pair. They are translations where the journals move in phase, tilts where they move in opposite phase.
An oscillating tilt is the nutation if its orbit is forward, the precession if it is backward. Faster modes of little
damping are bending modes. A rotor in one bearing has two translations. Modes that move an axis without orbit most, that
of a thrust bearing, are axial; the others are counted without them.

Nothing is named where these counts are not met: in a loop in which rotor and amplifiers swing together, for example.

Source: Schweitzer, Maslen (eds.), "Magnetic Bearings", Springer 2009, ch. 7 and 10.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from amb_core.linear.model.mode import Mode
from amb_core.linear.model.whirl import SensorPlane, in_phase

LEAST_PHASE = 0.3
"""Cosine between the journals below which a mode is neither a translation nor a tilt."""
MOST_BENDING_DAMPING = 0.3


def with_kinds(modes: tuple[Mode, ...], planes: tuple[SensorPlane, ...], least_gain: float) -> tuple[Mode, ...]:
    """The same modes, slowest first, with their kinds; modes below the least gain have none."""
    if len(planes) not in (1, 2):
        return modes
    states = 4 * len(planes)
    kinds, counted = [""] * len(modes), 0
    rigid: list[int] = []
    for number, mode in enumerate(modes):
        if mode.gain < least_gain:
            continue
        if _axial(mode, planes):
            kinds[number] = "axial"
        elif counted < states:
            rigid.append(number)
            kinds[number] = _rigid(mode, planes)
            counted += _states(mode)
        elif mode.oscillates and abs(mode.damping_ratio) < MOST_BENDING_DAMPING:
            kinds[number] = "bending"
    by_kind = {kind: sum(_states(modes[n]) for n in rigid if kinds[n] == kind) for kind in ("translation", "tilt")}
    if by_kind != {"translation": 4, "tilt": states - 4}:
        return modes
    for number in rigid:
        if kinds[number] == "tilt":
            kinds[number] = {"forward": "nutation", "backward": "precession"}.get(modes[number].whirl, "tilt")
    return tuple(replace(mode, kind=kind) for mode, kind in zip(modes, kinds, strict=True))


def _axial(mode: Mode, planes: tuple[SensorPlane, ...]) -> bool:
    """Whether the output that it moves most is in no sensor plane."""
    radial = {output for plane in planes for output in (plane.x, plane.y)}
    return int(np.argmax(np.abs(mode.shape))) not in radial


def _rigid(mode: Mode, planes: tuple[SensorPlane, ...]) -> str:
    if len(planes) == 1:
        return "translation"
    cosine = in_phase(mode.shape, *planes)
    if abs(cosine) < LEAST_PHASE:
        return ""
    return "translation" if cosine > 0.0 else "tilt"


def _states(mode: Mode) -> int:
    return 2 if mode.rate.imag > 0.0 else 1
