"""From continuous time to samples: inputs held over each sample, from its start or from a delay after it."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from amb_core.linear.system import Arrays, LinearSystem


def discretised(continuous: LinearSystem, sample_time: float, delay: float = 0.0) -> LinearSystem:
    """The discrete system of a continuous one whose inputs are held, each from a delay after its sample on.

    Parameters
    ----------
    continuous : LinearSystem
        In continuous time.
    sample_time : float
        Sample time (s).
    delay : float, optional
        0 up to the sample time (s). With a delay the inputs of the sample before are states, named `held_...`.

    References
    ----------
    G. F. Franklin, J. D. Powell and M. L. Workman, Digital Control of Dynamic Systems, 3rd edition, 1998, section 4.3.
    """
    n, m = continuous.b.shape
    signals = (continuous.input_names, continuous.output_names, continuous.input_units, continuous.output_units)
    if delay == 0.0:
        a, b = _held(continuous, sample_time)
        return LinearSystem(a, b, continuous.c, continuous.d, sample_time, *signals, continuous.state_names)
    late_a, late_b = _held(continuous, delay)
    rest_a, rest_b = np.eye(n), np.zeros((n, m))
    if delay < sample_time:
        rest_a, rest_b = _held(continuous, sample_time - delay)
    a = np.zeros((n + m, n + m))
    a[:n, :n], a[:n, n:] = rest_a @ late_a, rest_a @ late_b
    states = (*continuous.state_names, *(f"held_{name}" for name in continuous.input_names))
    return LinearSystem(
        a, np.vstack([rest_b, np.eye(m)]), np.hstack([continuous.c, np.zeros((continuous.outputs, m))]), continuous.d,
        sample_time, *signals, states if len(states) == n + m else (),
    )  # fmt: skip


def _held(continuous: LinearSystem, duration: float) -> tuple[Arrays, Arrays]:
    """A and B over a duration (s) with constant inputs: the upper rows of exp([[A, B], [0, 0]] duration)."""
    n, m = continuous.b.shape
    rates = np.zeros((n + m, n + m))
    rates[:n] = np.hstack([continuous.a, continuous.b])
    over = expm(duration * rates)
    return over[:n, :n], over[:n, n:]
