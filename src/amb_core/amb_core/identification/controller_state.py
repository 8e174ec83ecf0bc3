"""What a record shows of the controller's state: its past before the first sample, and whether it is the controller.

A linear controller is known exactly, as are the signals that it received and returned. With the recorded currents i,
its state obeys, at the limit or not,

    x[k+1] = (A - K C) x[k] + (B - K D) u[k] + K (i[k] - i_offset),
    i[k] = C x[k] + D u[k] + i_offset below the limit,

so that x[0] is a least-squares problem: the observability of the controller from its own currents.

Source: T. Kailath, Linear Systems, Prentice Hall, 1980, section 2.4 (observability and the initial state).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from amb_core.identification.control_law import LinearLaw, Start, law_of
from amb_core.loop.known_controller import KnownController, LinearControl
from amb_core.loop.records import LoopRecord

_WINDOW = 2_000  # samples that the state is found from
_GROWTH = 1e6  # largest growth of a state over the window
_LEAST_SHARE = 1e-9  # of the currents in all directions, below which a combination of them shows no state
_IRRELEVANT = 1.01  # factor by which directions of the state that are left at zero may raise the errors
_ROUNDING = 1e-13  # relative size of errors that only rounding causes
_AT_REST = 1e-3  # of the standard deviation of a current, up to which the law at rest explains the first one

Arrays = NDArray[np.float64]


def start_of(controller: KnownController, record: LoopRecord) -> Start | None:
    """The controller's past before the first sample of a record; None if it starts with that sample.

    The PD law starts with step 0. A linear one does if its state at rest explains the first current: data of other
    sources may count their steps from 0 wherever they begin.
    """
    if not isinstance(controller, LinearControl):
        # Data from the start of a run start with the controller; in others its first current shows its past.
        return Start(record.current[0]) if record.first_step > 0 and record.steps else None
    if not record.steps:
        return None
    law = law_of(controller, record.position.shape[1])
    assert isinstance(law, LinearLaw)
    if not law.order or (record.first_step == 0 and _begins_at_rest(law, record)):
        return None
    state, states, free = _reconstructed(law, record)
    # The smallest correction of the state, in units of how much it moves: independent of its coordinates.
    spread = states.T @ states / len(states)
    first = law.c @ state + law.d @ law.inputs(record.reference[0], record.position[0]) + law.output_offset
    shown = free[0] | (np.abs(first) < law.limit)
    gain = np.zeros((law.order, len(law.c)))
    part = law.c[shown]
    gain[:, shown] = spread @ part.T @ np.linalg.pinv(part @ spread @ part.T, rcond=_LEAST_SHARE, hermitian=True)
    return Start(record.current[0], state, gain)


def unexplained(controller: LinearControl, record: LoopRecord) -> Arrays:
    """Part of the recorded currents that a linear law does not compute from the recorded positions and references.

    Returns
    -------
    ndarray, shape (axes,)
        Root mean square of the difference over that of the current about its mean (-), over the samples below the
        limit; 0 for the controller of the experiment, but for rounding. NaN without such samples.
    """
    law = law_of(controller, record.position.shape[1])
    assert isinstance(law, LinearLaw)
    _, states, free = _reconstructed(law, record)
    count = len(states)
    inputs = law.inputs(record.reference[:count], record.position[:count])
    errors = record.current[:count] - (states @ law.c.T + inputs @ law.d.T + law.output_offset)
    shares = np.full(errors.shape[1], math.nan)
    for axis in range(errors.shape[1]):
        below = free[:count, axis]
        moved = float(record.current[:count, axis].std())
        if np.count_nonzero(below) > law.order and moved > 0.0:
            shares[axis] = float(np.sqrt(np.mean(errors[below, axis] ** 2))) / moved
    return shares


def _begins_at_rest(law: LinearLaw, record: LoopRecord) -> bool:
    inputs = law.inputs(record.reference[0], record.position[0])
    current = law.c @ (law.at_rest @ inputs) + law.d @ inputs + law.output_offset
    error = np.abs(np.clip(current, -law.limit, law.limit) - record.current[0])
    return bool(np.all(error <= _AT_REST * record.current.std(axis=0)))


def _reconstructed(law: LinearLaw, record: LoopRecord) -> tuple[Arrays, Arrays, NDArray[np.bool_]]:
    """State at the first sample, the states of the first samples, and where the currents are below their limit."""
    f = law.a - law.k @ law.c
    count = min(record.steps, _WINDOW)
    radius = float(np.abs(np.linalg.eigvals(f)).max(initial=0.0))
    if radius > 1.0:
        count = min(count, max(law.order + 1, int(math.log(_GROWTH) / math.log(radius))))
    inputs = law.inputs(record.reference[:count], record.position[:count])
    currents = record.current[:count] - law.output_offset
    free = np.abs(record.current[:count]) < law.limit
    driven = inputs @ (law.b - law.k @ law.d).T + currents @ law.k.T
    forced, rows = np.zeros((count, law.order)), np.empty((count, *law.c.shape))
    power = np.eye(law.order)
    for step in range(count):
        rows[step] = law.c @ power
        power = f @ power
        if step + 1 < count:
            forced[step + 1] = f @ forced[step] + driven[step]
    shown = currents - inputs @ law.d.T - forced @ law.c.T
    state = _least_squares(rows[free], shown[free])
    states, now = np.empty((count, law.order)), state
    for step in range(count):
        states[step] = now
        now = f @ now + driven[step]
    return state, states, free


def _least_squares(columns: Arrays, values: Arrays) -> Arrays:
    """The solution in the fewest directions, those that show best, that explain the values as well as all would.

    What noise or rounding of the recorded signals would blow up remains zero: it hardly shows in the currents.
    """
    if not columns.size:
        return np.zeros(columns.shape[1])
    scale = np.linalg.norm(columns, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    left, strength, right = np.linalg.svd(columns / scale, full_matrices=False)
    strength = strength[strength > np.finfo(float).eps * strength[0]]
    left, right = left[:, : len(strength)], right[: len(strength)]
    error, parts, errors = values.copy(), [], [float(np.linalg.norm(values))]
    for direction in left.T:
        parts.append(float(direction @ error))
        error = error - parts[-1] * direction
        errors.append(float(np.linalg.norm(error)))
    enough = _IRRELEVANT * errors[-1] + _ROUNDING * errors[0]
    rank = next(number for number, size in enumerate(errors) if size <= enough)
    return np.asarray((np.array(parts[:rank]) / strength[:rank]) @ right[:rank]) / scale
