"""Bearings that a model may not fit: what `misfit` draws, each from its seed.

A mass on a negative stiffness for each axis, an amplifier of first order, and a bending mode that all axes share; noise
on sensors and forces. A kind of misfit changes the bearing, its data, or what is said of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.signal import cont2discrete, lfilter

from amb_core.linear import Arrays, LinearSystem
from amb_core.linear.model import StateSpaceModel
from amb_core.loop.control import ControllerParameters
from amb_core.loop.records import LoopRecord, axis_names
from amb_core.robustness import RobustnessSettings, assess
from amb_core.robustness.feedback import Feedback, law_from_positions
from tests.benchmarks.robust.misfit_simulated import SIMULATED
from tests.benchmarks.verdicts.drawn_loops import DrawnLoop

RATE = 10_000.0  # Hz
CLEARANCE = 150e-6  # m
HONEST = "honest"
_NO_LIMIT = 100.0  # A, that no current reaches
_STIFFNESS = 3e5  # N/m, about that of the drawn bearings
_TRIED = 120_000  # steps, longer than the records, so that a bearing that falls is not drawn
KINDS = (
    "mode below", "mode inside", "mode above", "mode between lines", "dead time", "order too low", "coloured noise",
    "drift", "wrong controller", "saturation", "another speed", "wrong assumption", *SIMULATED,
    "two close modes", "mode on one axis", "wrong units", "swapped axes", "same record", "another machine",
    "unbalance",
)  # fmt: skip
"""Ways in which a bearing, its data or what is assumed of it do not fit the model."""


@dataclass(frozen=True, eq=False)
class MisfitPlant:
    """A bearing with its experiments.

    Attributes
    ----------
    kind : str
        What does not fit; `honest` if nothing.
    axes, order : int
        Number of axes, and order of the model that is identified.
    loop : DrawnLoop
        The bearing under the mild controller, with which the data are taken.
    aggressive : ControllerParameters
        A second controller, with more derivative.
    amplitude : float
        Of the reference (m, rms).
    lowest, highest : float
        Frequencies at which the excitation begins and ends (Hz).
    lines : int
        The excitation takes one line of so many.
    mode : tuple of float
        Frequency (Hz), damping ratio and gain relative to the rotor's of the bending mode; gain 0: none.
    other : DrawnLoop or None
        The bearing as it is now, if that is another one than that of the identification.
    """

    kind: str
    axes: int
    order: int
    loop: DrawnLoop
    aggressive: ControllerParameters
    amplitude: float
    lowest: float
    highest: float
    lines: int
    mode: tuple[float, float, float]
    other: DrawnLoop | None = None

    @property
    def mild(self) -> ControllerParameters:
        """The controller with which the data are taken."""
        return self.loop.controller

    def measured_peaks(self, law: ControllerParameters) -> NDArray[np.float64] | None:
        """Not measured: `true` is the bearing."""
        del law

    @property
    def true(self) -> LinearSystem:
        """From control currents to positions."""
        loop = self.other or self.loop
        a, b, c = loop.a, loop.b[:, : self.axes], loop.c
        return LinearSystem(a, b, c, np.zeros((self.axes, self.axes)), 1.0 / RATE)

    def record(self, steps: int, seed: int, now: bool = False) -> LoopRecord | None:
        """A multisine on all axes at once, on the bearing as it was or is now; None if the rotor falls."""
        random = np.random.default_rng([seed, 7])
        period = steps
        frequency = np.fft.rfftfreq(period, 1.0 / RATE)
        excited = (
            (frequency >= self.lowest) & (frequency <= self.highest) & (np.arange(len(frequency)) % self.lines == 0)
        )
        lines = np.zeros((len(frequency), self.axes), dtype=np.complex128)
        lines[excited] = np.exp(2j * np.pi * random.uniform(size=(int(excited.sum()), self.axes)))
        wave = np.fft.irfft(lines, period, axis=0)
        reference = np.tile(self.amplitude * wave / wave.std(axis=0), (-(-steps // period), 1))[:steps]
        record = ((now and self.other) or self.loop).run(reference, random)
        position = record.position
        if self.kind == "coloured noise":
            hum = lfilter([1.0], [1.0, -1.9, 0.96], random.normal(size=position.shape), axis=0)
            position = position + 2.0 * self.loop.sensor_noise * hum / hum.std()
        if self.kind == "drift":
            slow = lfilter([1.0], [1.0, -0.9999], random.normal(size=position.shape), axis=0)
            position = position + 20.0 * self.loop.sensor_noise * slow / slow.std()
        if np.abs(position).max() >= CLEARANCE:
            return None
        if self.kind == "wrong units":  # mm taken for m
            position = 1e3 * position
        if self.kind == "swapped axes":
            position = position[:, ::-1]
        return replace(record, position=position)


def draw(kind: str, seed: int, axes: int | None = None) -> MisfitPlant:
    """A bearing that both of its controllers hold, in simulation without a misfit or with it."""
    random = np.random.default_rng([seed, 3])
    for _ in range(200):
        plant = _draw(kind, random, axes)
        if plant is not None:
            return plant
    raise RuntimeError(f"no bearing of the kind {kind} was found")


def _draw(kind: str, random: np.random.Generator, wanted: int | None) -> MisfitPlant | None:
    axes = wanted or (4 if kind == "another speed" else int(random.choice([1, 2, 2, 3, 4])))
    axes = max(axes, 2) if kind in ("mode on one axis", "swapped axes") else axes
    mass, stiffness, gain = random.uniform(2.0, 15.0), random.uniform(1e5, 5e5), random.uniform(40.0, 150.0)
    bandwidth, delay = random.uniform(1_000.0, 2_500.0), int(random.integers(0, 2))
    if kind == "dead time":
        delay += int(random.integers(1, 4))
    lowest, highest, lines, (frequency, damping, share) = _excited_and_mode(kind, random)
    with_mode = kind not in ("dead time", "saturation") and (kind != HONEST or random.random() < 0.6)
    lacking = ("mode below", "mode inside", "mode above", "mode between lines", "mode on one axis")
    modelled = 0 if kind in lacking else 2
    seen = np.arange(axes) == random.integers(axes) if kind == "mode on one axis" else np.ones(axes, dtype=bool)
    beside = 1.0 + random.uniform(0.003, 0.05) if kind == "two close modes" else 0.0
    state = random.bit_generator.state
    mode = _Mode(frequency, damping, share * with_mode, seen, beside)
    plant = _plant((mass, stiffness, gain, bandwidth), mode, delay, random)
    natural = 2.0 * np.pi * random.uniform(40.0, 90.0)
    ratio = random.uniform(0.5, 0.9)
    mild = ControllerParameters(
        sample_rate=RATE,
        proportional_gain=(stiffness + mass * natural**2) / gain,
        derivative_gain=2.0 * ratio * natural * mass / gain,
        derivative_filter=random.uniform(0.5e-4, 2e-4),
        derivative_on="error",
        current_limit=_NO_LIMIT,
    )
    harder = 10.0 ** random.uniform(np.log10(1.3), np.log10(3.0))
    aggressive = mild.model_copy(update={"derivative_gain": harder * mild.derivative_gain, "current_limit": _NO_LIMIT})
    sensor = 10.0 ** random.uniform(-8.0, -7.0)
    loop = DrawnLoop(*plant, mild, sensor, 10.0 ** random.uniform(-2.0, -1.0), np.zeros(axes))
    order = axes * (3 + delay) + (modelled if with_mode else 0)
    if kind == "dead time":
        order = axes * 3
    if kind == "order too low":
        order = axes * 2
    other = None
    if kind == "another speed":
        again = np.random.default_rng()
        again.bit_generator.state = state
        moved = replace(mode, frequency=frequency * random.choice([0.9, 0.95, 1.05, 1.1]))
        other = _with_plant(loop, _plant((mass, stiffness, gain, bandwidth), moved, delay, again))
    if kind == "another machine":
        heavier, stiffer = random.uniform(0.7, 1.5, 2)
        other = _with_plant(loop, _plant((heavier * mass, stiffer * stiffness, gain, bandwidth), mode, delay, random))
    amplitude = 50.0 * sensor + 10.0 * loop.force_noise / stiffness
    misfit = MisfitPlant(
        kind, axes, order, loop, aggressive, amplitude, lowest, highest, lines,
        (frequency, damping, share * with_mode), other,
    )  # fmt: skip
    laws = [law_from_positions(one, axes) for one in (mild, aggressive)]
    if not all(
        Feedback(LinearSystem(one.a, one.b[:, :axes], one.c, np.zeros((axes, axes)), 1.0 / RATE), laws[0]).closed.radius
        < 0.9998
        for one in (loop, other or loop)
    ):
        return None
    if kind in _CHANGED:
        return _CHANGED[kind](misfit, random)
    if kind == HONEST:  # one that deserves a certificate
        model = named_model(misfit)
        of_true = assess(model, mild, RobustnessSettings(frequencies=100.0))
        if max(axis.sensitivity.value for axis in of_true.axes) > 2.2 or of_true.mu.upper > 0.7:
            return None
    return misfit


def _saturated(plant: MisfitPlant, random: np.random.Generator) -> MisfitPlant | None:
    """The bearing with a limit that its currents reach, and that holds it."""
    record = plant.record(_TRIED, 0)
    if record is None:
        return None
    limit = float(np.std(record.current, axis=0).max() * random.uniform(1.0, 3.0))
    limited = replace(
        plant, loop=replace(plant.loop, controller=plant.mild.model_copy(update={"current_limit": limit}))
    )
    return None if limited.record(_TRIED, 0) is None else limited


def _turning(plant: MisfitPlant, random: np.random.Generator) -> MisfitPlant:
    """The bearing with a rotor that turns, whose unbalance moves it about as much as the reference does."""
    force = _STIFFNESS * plant.amplitude * 10.0 ** random.uniform(-0.5, 1.5)
    return replace(plant, loop=replace(plant.loop, unbalance=force, speed=random.uniform(30.0, 500.0)))


_CHANGED: dict[str, Callable[[MisfitPlant, np.random.Generator], MisfitPlant | None]] = {
    "saturation": _saturated,
    "unbalance": _turning,
}


def named_model(plant: MisfitPlant) -> StateSpaceModel:
    """The true plant as a model, without noise."""
    true, names = plant.true, axis_names(plant.axes)
    inputs = tuple(f"i_{name}" for name in names)
    n, p = true.order, plant.axes
    return StateSpaceModel(
        true.a, true.b, true.c, true.d, np.zeros((n, p)), np.eye(p), np.zeros(p), np.zeros(p), np.zeros(n), 1.0 / RATE,
        inputs, names, input_units=("A",) * p, output_units=("m",) * p,
    )  # fmt: skip


def _excited_and_mode(kind: str, random: np.random.Generator) -> tuple[float, float, int, tuple[float, float, float]]:
    """Where the excitation begins and ends, its lines, and frequency, damping and gain of the mode."""
    lowest, highest, lines = 2.0, 4_600.0, 1
    damping, share = 10.0 ** random.uniform(-3.0, np.log10(0.02)), 10.0 ** random.uniform(-2.0, 0.0)
    frequency = 10.0 ** random.uniform(np.log10(200.0), np.log10(1_500.0))
    if kind == "mode below":
        frequency = 10.0 ** random.uniform(np.log10(8.0), np.log10(80.0))
        lowest = frequency * random.uniform(1.1, 2.0)
    elif kind == "mode inside":
        frequency = 10.0 ** random.uniform(np.log10(15.0), np.log10(1_500.0))
    elif kind == "mode above":
        highest = random.uniform(300.0, 1_500.0)
        frequency = highest * random.uniform(1.1, 3.0)
    elif kind == "mode between lines":
        lines = int(random.choice([10, 40]))
    elif kind == "wrong assumption":
        highest = random.uniform(1_500.0, 2_500.0)
        frequency, damping, share = random.uniform(200.0, 1_200.0), random.uniform(0.001, 0.004), 0.3
    return lowest, highest, lines, (frequency, damping, share)


def _with_plant(loop: DrawnLoop, plant: tuple[Arrays, Arrays, Arrays]) -> DrawnLoop:
    a, b, c = plant
    return replace(loop, a=a, b=b, c=c)


@dataclass(frozen=True)
class _Mode:
    """A bending mode, or two close ones: frequency (Hz), damping ratio, gain relative to the rotor's, axes that move.

    `beside` is the frequency of the second one relative to it; 0 for none.
    """

    frequency: float
    damping: float
    share: float
    seen: NDArray[np.bool_]
    beside: float


def _plant(rigid, mode, delay, random):
    """The discrete matrices of a plant whose axes have mass (kg), negative stiffness, current gain and bandwidth."""
    mass, stiffness, gain, bandwidth = rigid
    axes = len(mode.seen)
    block_a = np.zeros((3, 3))
    rate = 2.0 * np.pi * bandwidth
    block_a[0, 1], block_a[1, 0], block_a[1, 2], block_a[2, 2] = 1.0, stiffness / mass, gain / mass, -rate
    frequencies = [mode.frequency * ratio for ratio in (1.0, mode.beside) if ratio and mode.share]
    n = 3 * axes + 2 * len(frequencies)
    a, b, c = np.zeros((n, n)), np.zeros((n, 2 * axes)), np.zeros((axes, n))
    a[: 3 * axes, : 3 * axes] = block_diag(*[block_a] * axes)
    for axis in range(axes):
        b[3 * axis + 2, axis], b[3 * axis + 1, axes + axis], c[axis, 3 * axis] = rate, 1.0 / mass, 1.0
    for place, frequency in zip(range(3 * axes, n, 2), frequencies, strict=True):
        shape = random.uniform(0.3, 1.0, axes) * random.choice([-1.0, 1.0], axes) * mode.seen
        shape /= np.abs(shape).max()
        angular = 2.0 * np.pi * frequency
        a[place, place + 1], a[place + 1, place] = 1.0, -(angular**2)
        a[place + 1, place + 1] = -2.0 * mode.damping * angular
        a[place + 1, 2 : 3 * axes : 3] = mode.share * gain / mass * shape
        b[place + 1, axes:], c[:, place] = mode.share / mass * shape, shape
    mixed = np.eye(axes) + random.uniform(-0.03, 0.03, (axes, axes)) * (1.0 - np.eye(axes))
    a, b, c, *_ = cont2discrete((a, b, mixed @ c, np.zeros((axes, 2 * axes))), 1.0 / RATE)
    for _ in range(delay):  # of the currents
        a = np.block([[a, b[:, :axes]], [np.zeros((axes, len(a) + axes))]])
        b = np.block([[np.zeros((len(a) - axes, axes)), b[:, axes:]], [np.eye(axes), np.zeros((axes, axes))]])
        c = np.hstack([c, np.zeros((axes, axes))])
    return a, b, c
