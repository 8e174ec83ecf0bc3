"""Loops of random bearings under PD control, with their records: what the controllers and the bad data are drawn from.

Each axis is a mass on a negative stiffness behind an amplifier of first order, some with a bending mode, coupled with
the others; sensors and forces are noisy, and the currents have a limit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.signal import cont2discrete

from amb_core.loop.control import ControllerParameters, initial_state, pack_gains, pd_update
from amb_core.loop.records import LoopRecord, axis_names

KINDS = ("squares", "multisine", "prbs", "sweeps")
_CLEARANCE = 150e-6  # m, that a drawn loop keeps to
_LIMIT = 3.0  # A

Arrays = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class DrawnLoop:
    """A bearing, its controller, its noise and its excitation.

    Attributes
    ----------
    a, b, c : ndarray
        The plant for held currents (A) and forces (N), to positions (m).
    controller : ControllerParameters
        The PD law.
    sensor_noise, force_noise : float
        Rms (m, N).
    load : ndarray, shape (axes,)
        Static forces (N).
    unbalance, speed : float
        Amplitude (N) and frequency (Hz) of a force that turns.
    """

    a: Arrays
    b: Arrays
    c: Arrays
    controller: ControllerParameters
    sensor_noise: float
    force_noise: float
    load: Arrays
    unbalance: float = 0.0
    speed: float = 0.0

    def run(self, reference: Arrays, random: np.random.Generator) -> LoopRecord:
        """The loop under a reference (m), after half a second in which it has settled."""
        rate, axes = self.controller.sample_rate, len(self.c)
        lead = round(0.5 * rate)
        whole = np.vstack([np.tile(reference[:1], (lead, 1)), reference])
        forces = self.load + random.normal(scale=self.force_noise, size=whole.shape)
        noise = random.normal(scale=self.sensor_noise, size=whole.shape)
        if self.unbalance:
            angle = 2.0 * np.pi * self.speed / rate * np.arange(len(whole))
            forces += self.unbalance * np.cos(angle[:, np.newaxis] - 0.5 * np.pi * np.arange(axes))
        gains = pack_gains(self.controller, axes)
        position, current = _run(
            *map(np.ascontiguousarray, (self.a, self.b, self.c)), gains, initial_state(axes), whole, forces, noise
        )
        signals = whole[lead:], position[lead:], current[lead:]
        return LoopRecord(lead, 1.0 / rate, *signals, axis_names(axes))


def draw_record(
    random: np.random.Generator, steps: int | None = None, axes: int | None = None
) -> tuple[LoopRecord, DrawnLoop]:
    """A record of a random loop of 1 to 4 axes, excited by 1 to 20 um on each, that neither falls nor saturates."""
    axes = int(random.integers(1, 5)) if axes is None else axes
    while True:
        loop = draw_loop(random, axes)
        count = int(random.integers(4_000, 12_000)) if steps is None else steps
        kind = KINDS[random.integers(len(KINDS))]
        amplitude = float(np.exp(random.uniform(np.log(1e-6), np.log(20e-6))))
        reference = amplitude * excitation(kind, axes, count, loop.controller.sample_rate, random)
        record = loop.run(reference, random)
        size = np.abs(record.position).max() if np.isfinite(record.position).all() else np.inf
        if size < _CLEARANCE and np.abs(record.current).max() < 0.95 * _LIMIT:
            return record, loop


def draw_loop(random: np.random.Generator, axes: int) -> DrawnLoop:
    """A random bearing with gains that suit it."""
    mass, stiffness, gain = random.uniform(2.0, 15.0), random.uniform(1e5, 5e5), random.uniform(40.0, 150.0)
    natural, damping = 2.0 * np.pi * random.uniform(40.0, 90.0), random.uniform(0.4, 0.9)
    rate = float(random.choice([5_000.0, 10_000.0, 10_000.0, 20_000.0]))
    blocks = [_axis(random, mass, stiffness, gain) for _ in range(axes)]
    a = block_diag(*(block[0] for block in blocks))
    b = np.hstack([block_diag(*(block[1][:, place : place + 1] for block in blocks)) for place in (0, 1)])
    c = block_diag(*(block[2] for block in blocks))
    mixed = np.eye(axes) + random.uniform(-0.03, 0.03, (axes, axes)) * (1.0 - np.eye(axes))
    a, b, *_ = cont2discrete((a, b, c, np.zeros((axes, 2 * axes))), 1.0 / rate)
    spread = random.uniform(0.9, 1.1, axes)
    controller = ControllerParameters(
        sample_rate=rate,
        proportional_gains=tuple((spread * (stiffness + mass * natural**2) / gain).tolist()),
        derivative_gains=tuple((spread * 2.0 * damping * natural * mass / gain).tolist()),
        derivative_filter=float(random.choice([0.0, random.uniform(1e-4, 4e-4)])),
        derivative_on=str(random.choice(["error", "measurement"])),  # type: ignore[arg-type]
        current_limit=_LIMIT,
    )
    load = mass * 9.81 * np.where(random.random(axes) < 0.5, random.uniform(0.0, 0.7), 0.0)
    sensor = float(np.exp(random.uniform(np.log(0.01e-6), np.log(0.15e-6))))
    return DrawnLoop(a, b, mixed @ c, controller, sensor, float(random.uniform(0.05, 1.0)), load)


def _axis(random: np.random.Generator, mass: float, stiffness: float, gain: float) -> tuple[Arrays, Arrays, Arrays]:
    """Current and force to position of an axis in continuous time; half of the axes have a bending mode."""
    bandwidth = 2.0 * np.pi * random.uniform(1_000.0, 2_500.0)
    a, b, c = np.zeros((5, 5)), np.zeros((5, 2)), np.zeros((1, 5))
    a[0, 1], a[1, 0], a[1, 2], a[2, 2] = 1.0, stiffness / mass, gain / mass, -bandwidth
    b[2, 0], b[1, 1], c[0, 0] = bandwidth, 1.0 / mass, 1.0
    mode, share = 2.0 * np.pi * random.uniform(400.0, 1_200.0), random.choice([0.0, random.uniform(0.02, 0.15)])
    a[3, 4], a[4, 3], a[4, 4] = 1.0, -(mode**2), -0.04 * mode
    a[4, 2], b[4, 1], c[0, 3] = share * gain / mass, share / mass, 1.0
    return a, b, c


def excitation(kind: str, axes: int, steps: int, rate: float, random: np.random.Generator) -> Arrays:
    """Independent signals of amplitude one on all axes, shape (steps, axes)."""
    time, signals = np.arange(steps) / rate, np.empty((steps, axes))
    for axis in range(axes):
        if kind == "squares":
            signals[:, axis] = np.sign(np.sin(2.0 * np.pi * (random.uniform(8.0, 30.0) * time + random.random())))
        elif kind == "prbs":
            held = round(rate * random.uniform(0.5e-3, 3e-3))
            signals[:, axis] = np.repeat(random.choice([-1.0, 1.0], steps // held + 1), held)[:steps]
        elif kind == "multisine":
            lines = rate / steps * np.arange(1, max(int(800.0 * steps / rate), 2))
            lines = random.permutation(lines)[:200]
            phases = random.uniform(0.0, 2.0 * np.pi, len(lines))
            signals[:, axis] = np.cos(2.0 * np.pi * np.outer(time, lines) + phases).sum(axis=1)
            signals[:, axis] /= np.abs(signals[:, axis]).max()
        else:
            low, high = random.uniform(3.0, 15.0), random.uniform(300.0, 900.0)
            place = (time / time[-1] + axis / axes) % 1.0
            signals[:, axis] = np.sin(2.0 * np.pi * np.cumsum(low * (high / low) ** place) / rate)
    return signals


@numba.njit(cache=True)
def _run(
    a: Arrays, b: Arrays, c: Arrays, gains: Arrays, state: Arrays, reference: Arrays, forces: Arrays, noise: Arrays
) -> tuple[Arrays, Arrays]:
    steps, axes = reference.shape
    position, current = np.empty((steps, axes)), np.empty((steps, axes))
    x, held = np.zeros(len(a)), np.empty(2 * axes)
    for k in range(steps):
        position[k] = c @ x + noise[k]
        pd_update(state, gains, position[k], reference[k], current[k])
        held[:axes], held[axes:] = current[k], forces[k]
        x = np.dot(a, x) + np.dot(b, held)
    return position, current
