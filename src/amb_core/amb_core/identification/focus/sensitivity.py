"""How the simulated closed loop responds to small changes of the model: derivatives by forward simulation.

With the state x, the deviation u of the control current references from their offset, and the simulated position y,

    dx[k+1] = A dx[k] + B du[k] + dA x[k] + dB u[k],    dy[k] = C dx[k] + dC x[k] + dy_offset,

where du is the response of the control law to dy, which is linear as long as the current is below its limit. A current
at its limit does not respond: its du is 0, while the state of the law still follows dy.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from amb_core.identification.control_law import (
    Law,
    Start,
    advance_change,
    advance_law,
    change_of,
    law_of,
    recall,
    state_of,
)
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.linear.numerics import with_rows
from amb_core.linear.small_matrices import add_product, set_product
from amb_core.loop.known_controller import KnownController
from amb_core.loop.records import LoopRecord

_BLOCK = 1_000  # samples whose derivatives are held at once

Arrays = NDArray[np.float64]


@dataclass(frozen=True)
class LoopDirections:
    """Directions in which a model changes.

    Attributes
    ----------
    of_a, of_b, of_c : ndarray, shapes (n, n, q), (n, axes, q), (axes, n, q)
        Changes of A, B and C along each.
    of_offset : ndarray, shape (axes, r)
        Changes of the output offset along r additional directions (m).
    """

    of_a: Arrays
    of_b: Arrays
    of_c: Arrays
    of_offset: Arrays

    @property
    def count(self) -> int:
        """Number of directions q + r."""
        return self.of_a.shape[2] + self.of_offset.shape[1]


def sensitivity_factor(
    model: StateSpaceModel,
    controller: KnownController,
    record: LoopRecord,
    start_of_law: Start | None,
    directions: LoopDirections,
    scale: Arrays,
) -> Arrays:
    """Triangular factor of derivatives and errors of the simulated positions.

    Parameters
    ----------
    model, controller, start_of_law
        As in `simulate_closed_loop`, in a loop that does not diverge.
    record : LoopRecord
        The measured loop.
    directions : LoopDirections
        Changes of the model.
    scale : ndarray, shape (axes,)
        Errors and derivatives of each position are divided by it (m).

    Returns
    -------
    ndarray, shape (n + q + r + 1, n + q + r + 1)
        Columns: derivatives by the initial state, along the directions, and the errors, measured minus simulated.
    """
    n, columns = model.order, model.order + directions.count
    axes = len(model.c)
    law = law_of(controller, axes)
    linear = change_of(law)
    change = np.zeros((n, columns))  # of the state
    change[:, :n] = np.eye(n)
    by_state = np.ascontiguousarray(np.concatenate([directions.of_a, directions.of_b], axis=1))
    law_state, law_change = state_of(law), np.tile(state_of(law), (columns, 1))
    offset_change = np.zeros((axes, columns))
    offset_change[:, n : n + directions.of_offset.shape[1]] = directions.of_offset
    state = model.initial_state.copy()
    if start_of_law is not None:
        output = model.c @ state + model.output_offset
        recall(law, law_state, output, record.reference[0], start_of_law)
        first = model.c @ change + offset_change
        first[:, columns - directions.of_c.shape[2] :] += np.einsum("pnq,n->pq", directions.of_c, state)
        unchanged = Start(np.zeros(axes), np.zeros_like(start_of_law.state), start_of_law.gain)
        for column in range(columns):  # the law is linear, so it recalls changes from changes
            recall(linear, law_change[column], first[:, column], np.zeros(axes), unchanged)
    factor = np.zeros((0, columns + 1))
    for start in range(0, record.steps, _BLOCK):
        part = slice(start, min(start + _BLOCK, record.steps))
        rows = np.empty((part.stop - start, axes, columns + 1))
        _advance(
            model.a, model.b, model.c, model.input_offset, model.output_offset, by_state,
            np.ascontiguousarray(directions.of_c), offset_change, law, linear, record.reference[part],
            record.position[part], state, change, law_state, law_change, rows,
        )  # fmt: skip
        rows /= scale[:, np.newaxis]
        factor = with_rows(factor, rows.reshape(-1, columns + 1))
    return factor


@numba.njit(cache=True)
def _advance(
    a: Arrays,
    b: Arrays,
    c: Arrays,
    input_offset: Arrays,
    output_offset: Arrays,
    by_state: Arrays,
    of_c: Arrays,
    offset_change: Arrays,
    law: Law,
    linear: Law,
    reference: Arrays,
    position: Arrays,
    state: Arrays,
    change: Arrays,
    law_state: Arrays,
    law_change: Arrays,
    rows: Arrays,
) -> None:
    """Fill in `rows` (steps, axes, columns + 1) with derivatives and errors; advance states and changes in place."""
    n, columns = change.shape
    axes = len(output_offset)
    first = columns - of_c.shape[2]  # of the directions of A, B, C
    output, current, answer = np.empty(axes), np.empty(axes), np.empty(axes)
    moved, at_rest, free = np.empty(axes), np.zeros(axes), np.empty(axes, dtype=np.bool_)
    known = np.empty(n + axes)  # state and input
    input_change = np.empty((axes, columns))
    advanced, advanced_change = np.empty(n), np.empty((n, columns))
    for step in range(len(reference)):
        set_product(c, state, output)
        for axis in range(axes):
            output[axis] += output_offset[axis]
            rows[step, axis, columns] = position[step, axis] - output[axis]
            row = rows[step, axis]
            for column in range(columns):
                row[column] = offset_change[axis, column]
            for index in range(n):
                factor, along = c[axis, index], change[index]
                for column in range(columns):
                    row[column] += factor * along[column]
                value, direction, part = state[index], of_c[axis, index], row[first:columns]
                for column in range(columns - first):
                    part[column] += value * direction[column]
        advance_law(law, law_state, output, reference[step], current)
        for axis in range(axes):
            free[axis] = abs(current[axis]) < law.limit[axis]
        for column in range(columns):
            for axis in range(axes):
                moved[axis] = rows[step, axis, column]
            advance_change(linear, law_change[column], moved, at_rest, free, answer)
            for axis in range(axes):
                input_change[axis, column] = answer[axis]
        known[:n] = state
        known[n:] = current - input_offset
        for index in range(n):
            row = advanced_change[index]
            row[:] = 0.0
            for inner in range(n):
                factor, along = a[index, inner], change[inner]
                for column in range(columns):
                    row[column] += factor * along[column]
            for inner in range(axes):
                factor, along = b[index, inner], input_change[inner]
                for column in range(columns):
                    row[column] += factor * along[column]
            part = row[first:]
            for inner in range(n + axes):
                value, direction = known[inner], by_state[index, inner]
                for column in range(columns - first):
                    part[column] += value * direction[column]
        change[:] = advanced_change
        set_product(a, state, advanced)
        add_product(b, known[n:], advanced)
        state[:] = advanced
