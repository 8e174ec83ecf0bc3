"""The control law of an experiment inside compiled loops: the PD law, or any linear one.

Both have one interface: `advance_law` computes the currents of a sample, `advance_change` how they change with the
position. Which of the two laws it is, is decided when the loop is compiled. A state of a law is one array.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numba
import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from amb_core.loop.control import initial_state, pack_gains, pd_update
from amb_core.loop.known_controller import KnownController, LinearControl
from amb_core.loop.linear_control import linear_update, state_at_rest

Arrays = NDArray[np.float64]


class PdLaw(NamedTuple):
    """The PD law: coefficients of `pd_update`, shape (axes, 6). State: that of `pd_update`."""

    gains: Arrays
    limit: Arrays


class LinearLaw(NamedTuple):
    """A linear law, as `linear_update` takes it, with the map from its first inputs to its state at rest.

    The form of a `LinearControl` for compiled loops: numba takes named tuples of arrays, not objects.

    State: x, a place to work in of the same size, the inputs u, and 1 once it has begun.
    """

    a: Arrays
    b: Arrays
    c: Arrays
    d: Arrays
    k: Arrays
    at_rest: Arrays
    input_offset: Arrays
    output_offset: Arrays
    limit: Arrays

    @property
    def order(self) -> int:
        """Number of states."""
        return len(self.a)

    def inputs(self, reference: Arrays, output: Arrays) -> Arrays:
        """The inputs u (m), shape (..., m)."""
        errors = self.b.shape[1] == len(self.c)
        return (reference - output if errors else np.concatenate([reference, output], axis=-1)) - self.input_offset


Law = PdLaw | LinearLaw


@dataclass(frozen=True, eq=False)
class Start:
    """What is known of a controller that has run before the first sample.

    Attributes
    ----------
    current : ndarray, shape (axes,)
        Control current references with which it responded to the first sample (A).
    state : ndarray, shape (c,)
        Its state at the first sample, as the measured signals show it; empty for the PD law, whose currents show it.
    gain : ndarray, shape (c, axes)
        Correction of the state for a difference in the first currents, as it responds to a simulated position.
    """

    current: Arrays
    state: Arrays = field(default_factory=lambda: np.empty(0))
    gain: Arrays = field(default_factory=lambda: np.empty((0, 0)))


def law_of(controller: KnownController, axes: int) -> Law:
    """The law of a controller for a number of axes.

    Raises
    ------
    ParameterError
        If it is made for another number.
    """
    controller.require_axes(axes)
    if not isinstance(controller, LinearControl):
        gains = pack_gains(controller, axes)
        return PdLaw(gains, np.ascontiguousarray(gains[:, 5]))
    model = controller.model
    a, b, c, d, k = (np.ascontiguousarray(getattr(model, name)) for name in ("a", "b", "c", "d", "k"))
    limit = np.full(axes, controller.current_limit)
    return LinearLaw(a, b, c, d, k, state_at_rest(model), model.input_offset, model.output_offset, limit)


def change_of(law: Law) -> Law:
    """The law of small changes: no limits, no offsets."""
    unlimited = np.full(len(law.limit), np.inf)
    if isinstance(law, LinearLaw):
        return law._replace(
            limit=unlimited,
            input_offset=np.zeros_like(law.input_offset),
            output_offset=np.zeros_like(law.output_offset),
        )
    gains = law.gains.copy()
    gains[:, 5] = np.inf
    return PdLaw(gains, unlimited)


def state_of(law: Law) -> Arrays:
    """State of a law before its first sample."""
    if isinstance(law, LinearLaw):
        return np.zeros(2 * law.order + law.b.shape[1] + 1)
    return initial_state(len(law.gains))


def recall(law: Law, state: Arrays, output: Arrays, reference: Arrays, start: Start) -> None:
    """Set the state that a law had before a sample, from the currents with which it responded to that sample.

    At the current limit the derivative of the PD law is only known to be large, but then it has hardly any influence on
    the following samples: without a filter it is lost after one sample.
    """
    if isinstance(law, PdLaw):
        _recall_pd(law.gains, state, output, reference, start.current)
        return
    known = start.state if len(start.state) else np.zeros(law.order)
    gain = start.gain if start.gain.size else np.linalg.pinv(law.c)
    current = law.c @ known + law.d @ law.inputs(reference, output) + law.output_offset
    state[: law.order] = known + gain @ (start.current - current)
    state[-1] = 1.0


def _recall_pd(gains: Arrays, state: Arrays, output: Arrays, reference: Arrays, current: Arrays) -> None:
    proportional, derivative, keep, weight, on_error, _ = gains.T
    if not derivative.any():
        return
    axes = len(gains)
    # On an axis without derivative the state has no effect.
    derived = (current - proportional * (reference - output)) / np.where(derivative == 0.0, 1.0, derivative)
    # Of the two states that lead to `derived`, the filtered derivative is taken to be stationary.
    state[:axes] = derived
    state[axes : 2 * axes] = on_error * reference - output - (1.0 - keep) * derived / weight
    state[2 * axes] = 1.0


@numba.njit(cache=True)
def linear_sample(state: Arrays, law: LinearLaw, position: Arrays, reference: Arrays, current: Arrays) -> None:
    """Advance a linear law by one sample, as `LinearController.update` does."""
    order, axes, count = len(law.a), len(position), law.b.shape[1]
    inputs = state[2 * order : 2 * order + count]
    for axis in range(axes):
        if count == axes:
            inputs[axis] = reference[axis] - position[axis]
        else:
            inputs[axis] = reference[axis]
            inputs[axes + axis] = position[axis]
    for number in range(count):
        inputs[number] -= law.input_offset[number]
    if state[-1] == 0.0:
        state[-1] = 1.0
        for row in range(order):
            total = 0.0
            for number in range(count):
                total += law.at_rest[row, number] * inputs[number]
            state[row] = total
    matrices = (law.a, law.b, law.c, law.d, law.k)
    linear_update(state[:order], state[order : 2 * order], matrices, inputs, law.output_offset, law.limit[0], current)


def advance_law(law: Any, state: Any, position: Any, reference: Any, current: Any) -> None:
    """Advance a law by one sample: `current` (axes,) receives the limited currents (A). In compiled code only."""
    raise NotImplementedError


def advance_change(law: Any, state: Any, position: Any, at_rest: Any, free: Any, current: Any) -> None:
    """Advance the change of a law by one sample; an axis that is not `free` is at its limit and does not respond.

    `law` is from `change_of`, `at_rest` is a reference of zero. In compiled code only.
    """
    raise NotImplementedError


@overload(advance_law)
def _advance_law(law: Any, state: Any, position: Any, reference: Any, current: Any) -> Callable[..., None] | None:
    kind = getattr(law, "instance_class", None)

    def of_pd(law: Any, state: Any, position: Any, reference: Any, current: Any) -> None:
        pd_update(state, law.gains, position, reference, current)

    def of_linear(law: Any, state: Any, position: Any, reference: Any, current: Any) -> None:
        linear_sample(state, law, position, reference, current)

    return of_pd if kind is PdLaw else of_linear if kind is LinearLaw else None


@overload(advance_change)
def _advance_change(
    law: Any, state: Any, position: Any, at_rest: Any, free: Any, current: Any
) -> Callable[..., None] | None:
    kind = getattr(law, "instance_class", None)

    def of_pd(law: Any, state: Any, position: Any, at_rest: Any, free: Any, current: Any) -> None:
        pd_update(state, law.gains, position, at_rest, current)
        for axis in range(len(current)):
            if not free[axis]:
                current[axis] = 0.0

    def of_linear(law: Any, state: Any, position: Any, at_rest: Any, free: Any, current: Any) -> None:
        linear_sample(state, law, position, at_rest, current)
        for axis in range(len(current)):
            if not free[axis]:  # what the law asks for changes, the current does not: the anti-windup sees that
                for row in range(len(law.a)):
                    state[row] -= law.k[row, axis] * current[axis]
                current[axis] = 0.0

    return of_pd if kind is PdLaw else of_linear if kind is LinearLaw else None
