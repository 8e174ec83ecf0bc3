"""Axes that an excitation excites: what the text `axes` of a definition means for a machine.

A rigid mode moves the sensors of a direction e in a fixed ratio: a translation that of axis i by d_i . e, a tilt by
z_i d_i . e, with the direction d_i of the axis and the axial position z_i of its sensor from the centre of mass.

In orthogonal experiments U(k) = diag(phases of each axis) W holds the amplitudes of all axes (rows) in all experiments
(columns) at a line k. If the number of axes is a power of two, W is a Hadamard matrix: it changes signs only, so the
crest factors are the same in all experiments. Otherwise it is the matrix of the discrete Fourier transform, which
exists for any number.

Sources: T. P. Dobrowiecki, J. Schoukens and P. Guillaume, "Optimized excitation signals for MIMO frequency response
function measurements", IEEE Trans. Instrumentation and Measurement 55 (2006) 2072-2079; R. Pintelon and J. Schoukens,
System Identification: A Frequency Domain Approach, 2nd ed., Wiley 2012, section 3.7.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import ExcitationError
from amb_core.loop.machine import DIRECTIONS, ONE_BEARING, Machine

ALL, BOTH, IN_TURN, ORTHOGONAL = "all", "both", "in_turn", "orthogonal"
BEARING = "bearing_"
MODES = (*(f"translate_{direction}" for direction in DIRECTIONS), "tilt_x", "tilt_y")

AXES_DESCRIPTION = (
    "axes that are excited: names joined with commas, a bearing (bearing_a), a rigid mode (translate_x, tilt_y), all, "
    "in_turn (one after another) or, for multisine, orthogonal"
)

_LEAST = 1e-9  # component of an axis along a direction, or distance of two planes over the largest position
_QUOTED = 60  # characters of a wrong text in a message


@dataclass(frozen=True)
class Part:
    """One signal over a span of steps, and the axes to which it is added.

    Attributes
    ----------
    first, stop : int
        First step, and the step after the last.
    realisation : int
        Number of the axis whose signal it is: kinds with a random part draw another one for each axis.
    factors : tuple of (int, float)
        Excited axes, each with its factor on the signal; the largest magnitude is 1.
    turn : float
        Angle that is added to the phases of all lines, over 2 pi; 0 except in orthogonal experiments.
    """

    first: int
    stop: int
    realisation: int
    factors: tuple[tuple[int, float], ...]
    turn: float = 0.0


def parts_of(axes: str, steps: int, machine: Machine | None = None) -> list[Part]:
    """The parts of a signal of a number of steps, in the order of their first steps.

    Parameters
    ----------
    axes : str
        Names of axes and bearings joined with commas, a rigid mode, `all`, `both`, `in_turn` or `orthogonal`.
    steps : int
        Number of samples of the whole signal.
    machine : Machine, optional
        By default one bearing with axes x and y.

    Raises
    ------
    ExcitationError
        If the machine has no such axes, or orthogonal experiments would not be equally long; one line.
    """
    machine = machine or ONE_BEARING
    count = len(machine.axes)
    if axes == IN_TURN:
        return [Part(*_span(axis, count, steps), axis, ((axis, 1.0),)) for axis in range(count)]
    if axes == ORTHOGONAL:
        return _orthogonal(steps, count)
    if axes in MODES:
        factors = mode_factors(axes, machine)
        return [Part(0, steps, factors[0][0], factors)]
    return [Part(0, steps, axis, ((axis, 1.0),)) for axis in _excited(axes, machine, (IN_TURN, ORTHOGONAL))]


def factors_of(axes: str, machine: Machine) -> NDArray[np.float64]:
    """Factor of one signal on every axis that it excites at a time, shape (axes,); 0 for axes at rest.

    Parameters
    ----------
    axes : str
        Names of axes and bearings joined with commas, a rigid mode, `all`, or `both`.
    machine : Machine
        The machine.

    Raises
    ------
    ExcitationError
        If the machine has no such axes, or they are excited one after another.
    """
    if axes in (IN_TURN, ORTHOGONAL):
        raise ExcitationError(f"axes = '{axes}' is not allowed here; allowed: axes excited at the same time")
    factors = np.zeros(len(machine.axes))
    if axes in MODES:
        for axis, factor in mode_factors(axes, machine):
            factors[axis] = factor
    else:
        factors[_excited(axes, machine, sequences=())] = 1.0
    return factors


def mode_factors(mode: str, machine: Machine) -> tuple[tuple[int, float], ...]:
    """Axes that a rigid mode moves, and the factor on each; the largest magnitude is 1.

    Parameters
    ----------
    mode : str
        One of `MODES`.
    machine : Machine
        Directions and sensor positions of its axes are used.

    Raises
    ------
    ExcitationError
        If no axis acts along the direction, or the axial positions do not determine a tilt.
    """
    kind, direction = mode.split("_")
    along = np.array([axis.direction for axis in machine.axes]) @ DIRECTIONS[direction]
    acting = np.flatnonzero(np.abs(along) > _LEAST)
    if not len(acting):
        raise ExcitationError(f"axes = '{mode}' is not allowed: no axis of this machine acts along {direction}")
    shape = along[acting]
    if kind == "tilt":
        positions = np.array([machine.axes[axis].sensor_position for axis in acting])
        names = ", ".join(machine.axes[axis].name for axis in acting)
        if not np.isfinite(positions).all():
            raise ExcitationError(f"axes = '{mode}' is not allowed: axial positions of the sensors {names} are unknown")
        if np.ptp(positions) <= _LEAST * np.max(np.abs(positions)):
            raise ExcitationError(
                f"axes = '{mode}' is not allowed: the sensors along {direction} ({names}) lie in one plane"
            )
        shape = shape * positions
    shape = shape / np.max(np.abs(shape))
    return tuple((int(axis), float(factor)) for axis, factor in zip(acting, shape, strict=True) if factor)


def turns(count: int) -> NDArray[np.float64]:
    """Angles over 2 pi of the factors W on each axis (row) in each experiment (column), W W^H = count I.

    Returns
    -------
    ndarray, shape (count, count)
        0 or more, less than 1; half a turn is a change of sign.
    """
    if count & (count - 1):  # no power of two
        number = np.arange(count)
        return np.outer(number, number) % count / count
    from scipy.linalg import hadamard  # slow to import, and not needed by other excitations

    return np.asarray((1.0 - hadamard(count)) / 4.0)


def _orthogonal(steps: int, count: int) -> list[Part]:
    """Experiments of equal length: all axes excited in each, with factors as of `turns`."""
    if steps % count:
        below = steps - steps % count
        raise ExcitationError(
            f"axes = '{ORTHOGONAL}': {steps} samples cannot be divided into {count} equal experiments; "
            f"allowed: a duration of {below} or {below + count} samples"
        )
    angles = turns(count)
    parts = []
    for experiment in range(count):
        for axis in range(count):
            turn = float(angles[axis, experiment])
            sign, rest = (-1.0, 0.0) if turn == 0.5 else (1.0, turn)
            parts.append(Part(*_span(experiment, count, steps), axis, ((axis, sign),), rest))
    return parts


def _span(number: int, count: int, steps: int) -> tuple[int, int]:
    """First and stop step of one of several equal spans; remaining steps belong to the last."""
    each = steps // count
    return number * each, steps if number == count - 1 else (number + 1) * each


def _excited(axes: str, machine: Machine, sequences: tuple[str, ...]) -> list[int]:
    """Numbers of the axes that a list names, in the order of the machine; an error offers the sequences as well."""
    if axes == ALL or (axes == BOTH and len(machine.axes) == 2):
        return list(range(len(machine.axes)))
    named: list[int] = []
    for name in (item.strip() for item in axes.split(",")):
        numbers = [number for number, axis in enumerate(machine.axes) if name in (axis.name, BEARING + axis.bearing)]
        if not numbers:
            raise ExcitationError(_unknown(name, axes, machine, sequences))
        named += numbers
    if len(set(named)) < len(named):
        raise ExcitationError(f"axes = {_quoted(axes)} is not allowed: it names an axis twice")
    return sorted(named)


def _unknown(name: str, axes: str, machine: Machine, sequences: tuple[str, ...]) -> str:
    """What is wrong with a name, and what the machine has instead."""
    names = [*machine.axis_names, *(BEARING + bearing.name for bearing in machine.bearings)]
    words = [*_possible_modes(machine), ALL, *([BOTH] if len(machine.axes) == 2 else []), *sequences]
    allowed = f"allowed: {', '.join(names)} (several joined with commas), {', '.join(words)}"
    close = [ALL] if name == BOTH else difflib.get_close_matches(name, [*names, *words], 1)
    hint = f"did you mean '{close[0]}'? " if close else ""
    where = "" if name == axes else f" in {_quoted(axes)}"
    return f"axes = {_quoted(name)}{where} is not allowed; {hint}{allowed}"


def _possible_modes(machine: Machine) -> Iterator[str]:
    for mode in MODES:
        try:
            mode_factors(mode, machine)
        except ExcitationError:
            continue
        yield mode


def _quoted(text: str) -> str:
    return repr(text if len(text) <= _QUOTED else f"{text[:_QUOTED]} ...")
