"""Small tones on one axis after another: the controller that makes them, their waveform, and the response to them.

Before the first lift-off the target plays them open loop: a controller without inputs, whose state turns, asks for
the currents, and the rotor stays on its backup bearing. Levitated, they are an excitation of the reference.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from amb_core.linear.model import StateSpaceModel
from amb_core.loop.records import LoopRecord

_TRIES = 50


@dataclass(frozen=True, eq=False)
class ToneSet:
    """Tones whose periods all fit into one window.

    Attributes
    ----------
    frequency : ndarray, shape (tones,)
        (Hz).
    amplitude : ndarray, shape (tones,)
        Relative to the peak of their sum.
    phase : ndarray, shape (tones,)
        At the first sample (rad).
    """

    frequency: NDArray[np.float64]
    amplitude: NDArray[np.float64]
    phase: NDArray[np.float64]

    def waveform(self, steps: int, sample_rate: float) -> NDArray[np.float64]:
        """Their sum, shape (steps,), within -1 to 1."""
        angle = 2.0 * np.pi * self.frequency * np.arange(steps)[:, np.newaxis] / sample_rate + self.phase
        return np.asarray(np.cos(angle) @ self.amplitude)


@cache
def tone_set(low: float, high: float, tones: int, window: float, power: float = 0.0) -> ToneSet:
    """Tones from `low` to `high` (Hz), evenly in the logarithm, with whole periods in a window (s).

    Parameters
    ----------
    low, high : float
        Frequencies (Hz).
    tones : int
        Their number.
    window : float
        (s).
    power : float
        Amplitudes rise with this power of the frequency.
    """
    frequency = np.unique(np.round(np.geomspace(low, high, tones) * window)) / window
    amplitude = (frequency / high) ** power
    generator = np.random.default_rng(1)
    time = np.linspace(0.0, window, 4096, endpoint=False)
    best, peak = np.zeros(len(frequency)), np.inf
    for _ in range(_TRIES):
        phase = generator.uniform(0.0, 2.0 * np.pi, len(frequency))
        crest = np.abs(np.cos(2.0 * np.pi * np.outer(time, frequency) + phase) @ amplitude).max()
        if crest < peak:
            best, peak = phase, crest
    return ToneSet(frequency, amplitude / (1.02 * peak), best)


def generator_of(tones: ToneSet, axis: int, axes: int, peak: float, sample_rate: float) -> StateSpaceModel:
    """Controller without inputs that plays tones on one axis, with this peak of its control current (A)."""
    order = 2 * len(tones.frequency)
    a, c, x = np.zeros((order, order)), np.zeros((axes, order)), np.zeros(order)
    for number, frequency in enumerate(tones.frequency):
        angle, at = 2.0 * np.pi * frequency / sample_rate, 2 * number
        a[at : at + 2, at : at + 2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        x[at : at + 2] = np.cos(tones.phase[number]), np.sin(tones.phase[number])
        c[axis, at] = peak * tones.amplitude[number]
    none = np.zeros((axes, axes))
    names = tuple(f"e_{number}" for number in range(axes)), tuple(f"i_{number}" for number in range(axes))
    return StateSpaceModel(
        a=a, b=np.zeros((order, axes)), c=c, d=none, k=1e-9 * np.eye(order, axes), innovation_covariance=none,
        input_offset=-np.eye(1, axes)[0], output_offset=np.zeros(axes), initial_state=x, sample_time=1.0 / sample_rate,
        input_names=names[0], output_names=names[1], input_units=("m",) * axes, output_units=("A",) * axes,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class ToneResponse:
    """What signals do at the tones.

    Attributes
    ----------
    position, current, reference : ndarray of complex, shape (tones, axes)
        Amplitudes (m, A, m).
    deviation : ndarray, shape (axes,)
        Standard deviation of the amplitudes of the positions (m).
    """

    position: NDArray[np.complex128]
    current: NDArray[np.complex128]
    reference: NDArray[np.complex128]
    deviation: NDArray[np.float64]


def response_to(tones: ToneSet, record: LoopRecord) -> ToneResponse:
    """Amplitudes at the tones by least squares, beside a slow drift."""
    time = np.arange(record.steps) * record.sample_time
    waves = np.exp(2j * np.pi * np.outer(time, tones.frequency))
    drift = np.linspace(-1.0, 1.0, record.steps)
    columns = np.column_stack([waves.real, -waves.imag, np.ones(len(time)), drift, drift**2, drift**3])
    signals = np.hstack([record.position, record.current, record.reference])
    coefficients, _, _, _ = np.linalg.lstsq(columns, signals, rcond=None)
    left = record.position - columns @ coefficients[:, : len(record.axes)]
    count, axes = len(tones.frequency), len(record.axes)
    amplitude = coefficients[:count] + 1j * coefficients[count : 2 * count]
    parts = amplitude[:, :axes], amplitude[:, axes : 2 * axes], amplitude[:, 2 * axes :]
    return ToneResponse(*parts, left.std(axis=0) * np.sqrt(2.0 / record.steps))
