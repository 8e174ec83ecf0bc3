"""Simulation of a linear system, sample by sample."""

from __future__ import annotations

import numba
import numpy as np

from amb_core.linear.small_matrices import add_product, set_product
from amb_core.linear.system import Arrays, LinearSystem


def simulate(system: LinearSystem, signals: Arrays, state: Arrays | None = None) -> Arrays:
    """Outputs y[k], shape (steps, p), for inputs u[k].

    Parameters
    ----------
    system : LinearSystem
        Discrete.
    signals : ndarray, shape (steps, m)
        Inputs.
    state : ndarray, shape (n,), optional
        State at the first sample, by default zero.
    """
    a, b, c, d, signals = (np.ascontiguousarray(one) for one in (system.a, system.b, system.c, system.d, signals))
    state = np.zeros(system.order) if state is None else np.array(state, dtype=np.float64)
    outputs = np.empty((len(signals), system.outputs))
    _simulate(a, b, c, d, state, np.empty(system.order), signals, outputs)
    return outputs


def state_sequence(a: Arrays, b: Arrays, signals: Arrays, state: Arrays) -> Arrays:
    """States of x[k+1] = A x[k] + B u[k], shape (steps, n), from the one at the first sample."""
    states = np.empty((len(signals), len(a)))
    a, b, state, signals = (np.ascontiguousarray(one) for one in (a, b, state, signals))
    _advance(a, b, state, signals, states)
    return states


@numba.njit(cache=True)
def _advance(a: Arrays, b: Arrays, state: Arrays, signals: Arrays, states: Arrays) -> None:
    for index in range(len(state)):
        states[0, index] = state[index]
    for step in range(1, len(signals)):
        set_product(a, states[step - 1], states[step])
        add_product(b, signals[step - 1], states[step])


@numba.njit(cache=True)
def _simulate(
    a: Arrays, b: Arrays, c: Arrays, d: Arrays, state: Arrays, advanced: Arrays, signals: Arrays, outputs: Arrays
) -> None:
    """Fill in the outputs from the state at the first sample; `advanced` is work space of its shape."""
    for step in range(len(signals)):
        set_product(c, state, outputs[step])
        add_product(d, signals[step], outputs[step])
        set_product(a, state, advanced)
        add_product(b, signals[step], advanced)
        state, advanced = advanced, state
