"""Bearings, experiments and wrong models that `make bench-verdicts` draws, each from its seed.

    m (I + coupling) q'' = k_s q + k_i i + f + bending mode,    amplifiers of first order,

on 1 to 4 axes under the PD law of `LinearLoop`, with white noise on sensors and forces. The true model has the gain of
the stationary Kalman filter of that noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.signal import cont2discrete

from amb_core.ground.units import UM
from amb_core.identification import IdentificationData, StateSpaceModel
from amb_core.identification.estimate.predictor import kalman_gain
from amb_core.identification.validation import predict
from amb_core.loop.control import ControllerParameters
from tests.benchmarks.ident.linear_loop import SAMPLE_TIME, LinearLoop, model_of

Arrays = NDArray[np.float64]

MOST_DAMPED = 0.999  # radius of the poles of a drawn loop at most: it settles within the record
KINDS = ("squares", "multisine", "sweep")
WRONG = ("gain", "delay", "stiffness", "mode", "order", "swapped", "other bearing", "sign")


@dataclass(frozen=True)
class Bearing:
    """Physical parameters of a bearing with its controller and noise.

    Attributes
    ----------
    axes : int
        Number of axes.
    mass : float
        Moved mass of an axis (kg).
    coupling : tuple of float
        Share of the acceleration of an axis that forces on the next one cause.
    current_gain, stiffness : float
        k_i (N/A) and magnitude of the negative stiffness k_s (N/m).
    bandwidth : float
        Of the amplifiers (Hz).
    frequency, damping, share : float
        Of the bending mode: frequency (Hz), damping ratio, and its acceleration by a force relative to the rotor's.
    shape : tuple of float
        Of the bending mode along the axes.
    proportional, derivative, keep : float
        K_P (A/m), K_D (A s/m) and the share that the filter of the derivative keeps over a sample.
    sensor_noise, force_noise : float
        Rms (m, N).
    """

    axes: int
    mass: float
    coupling: tuple[float, ...]
    current_gain: float
    stiffness: float
    bandwidth: float
    frequency: float
    damping: float
    share: float
    shape: tuple[float, ...]
    proportional: float
    derivative: float
    keep: float
    sensor_noise: float
    force_noise: float

    def loop(self, gains: Arrays | None = None, with_mode: bool = True) -> LinearLoop:
        """The loop; `gains` multiply the current gains of the axes."""
        axes, count = self.axes, 1 if with_mode else 0
        inverse = (np.eye(axes) + np.diag(self.coupling, 1) + np.diag(self.coupling, -1)) / self.mass
        n = 3 * axes + 2 * count
        a, b = np.zeros((n, n)), np.zeros((n, 2 * axes))
        position, speed, current = slice(0, axes), slice(axes, 2 * axes), slice(2 * axes, 3 * axes)
        current_gain = self.current_gain * np.diag(np.ones(axes) if gains is None else gains)
        a[position, speed] = np.eye(axes)
        a[speed, position], a[speed, current] = self.stiffness * inverse, inverse @ current_gain
        rate = 2.0 * np.pi * self.bandwidth
        a[current, current], b[current, :axes] = -rate * np.eye(axes), rate * np.eye(axes)
        b[speed, axes:] = inverse
        c = np.zeros((axes, n))
        c[:, position] = np.eye(axes)
        if with_mode:
            angular, shape = 2.0 * np.pi * self.frequency, np.array(self.shape)
            a[-2, -1], a[-1, -2], a[-1, -1] = 1.0, -(angular**2), -2.0 * self.damping * angular
            a[-1, current] = self.share / self.mass * shape @ current_gain
            b[-1, axes:] = self.share / self.mass * shape
            c[:, -2] = shape
        a, b, *_ = cont2discrete((a, b, c, np.zeros((axes, b.shape[1]))), SAMPLE_TIME)
        law = np.full(axes, self.proportional), np.full(axes, self.derivative)
        return LinearLoop(a, b[:, :axes], c, b[:, axes:], *law, self.keep, self.sensor_noise, self.force_noise)

    def true_model(self) -> StateSpaceModel:
        """The truth about the data of `draw_data`, in innovations form."""
        return model_in_innovations_form(self.loop())

    @property
    def controller(self) -> ControllerParameters:
        """Its law, without a limit that these motions reach."""
        return ControllerParameters(
            proportional_gain=self.proportional, derivative_gain=self.derivative, current_limit=100.0,
            derivative_filter=SAMPLE_TIME * self.keep / (1.0 - self.keep), derivative_on="measurement",
        )  # fmt: skip


def draw_bearing(random: np.random.Generator, axes: int | None = None) -> Bearing:
    """A bearing whose loop is stable and settles."""
    axes = int(random.integers(1, 5)) if axes is None else axes
    while True:
        mass, current_gain = random.uniform(1.0, 15.0), random.uniform(20.0, 150.0)
        stiffness = mass * (2.0 * np.pi * random.uniform(20.0, 60.0)) ** 2
        wanted = random.uniform(2.0, 4.0) * stiffness  # of the loop, before the negative stiffness
        damping = 2.0 * random.uniform(0.35, 0.8) * np.sqrt((wanted - stiffness) * mass)
        noise = 10.0 ** random.uniform(np.log10(0.3), 1.0)
        shape = random.uniform(0.4, 1.0, axes) * random.choice([-1.0, 1.0], axes)
        bearing = Bearing(
            axes, mass, tuple(random.uniform(0.05, 0.25, axes - 1)), current_gain, stiffness,
            random.uniform(1_000.0, 3_000.0), random.uniform(300.0, 1_500.0), 10.0 ** random.uniform(-2.5, -1.5),
            random.uniform(0.1, 0.5), tuple(shape / np.abs(shape).max()), wanted / current_gain,
            damping / current_gain, random.uniform(0.1, 0.6), 0.02e-6 * noise,
            0.03e-6 * stiffness * random.uniform(0.3, 3.0) * noise,
        )  # fmt: skip
        loop = bearing.loop()
        if np.abs(loop.poles(loop.a, loop.b, loop.c)).max() < MOST_DAMPED:
            return bearing


def draw_data(
    bearing: Bearing, random: np.random.Generator, steps: int, like: IdentificationData | None = None
) -> tuple[IdentificationData, str]:
    """An experiment of 1 to 20 um on a bearing, or one with the reference of another; and in words what it was."""
    kind = str(random.choice(KINDS))
    amplitude = 1e-6 * 10.0 ** random.uniform(0.0, np.log10(20.0))
    reference = amplitude * excitation(kind, bearing.axes, steps, random)
    if like is not None and like.experiments[0].reference is not None:
        reference = like.experiments[0].reference
    inputs, outputs = bearing.loop().run(reference, random)
    names = tuple(f"{axis + 1}" for axis in range(bearing.axes))
    data = IdentificationData.from_arrays(
        inputs, outputs, SAMPLE_TIME, reference=reference, input_names=[f"i_{name}" for name in names],
        output_names=[f"x_{name}" for name in names], input_units=["A"] * bearing.axes,
        output_units=["m"] * bearing.axes,
    )  # fmt: skip
    return data, f"{kind}, {1e6 * amplitude:.1f} um"


def excitation(kind: str, axes: int, steps: int, random: np.random.Generator) -> Arrays:
    """Of amplitude 1 (multisine: rms)."""
    time = np.arange(steps) * SAMPLE_TIME
    if kind == "multisine":
        frequency = np.fft.rfftfreq(steps, SAMPLE_TIME)
        excited = (frequency >= 1.0) & (frequency <= random.uniform(300.0, 2_000.0))
        lines = np.zeros((len(frequency), axes), dtype=np.complex128)
        lines[excited] = np.exp(2j * np.pi * random.uniform(size=(int(excited.sum()), axes)))
        samples = np.fft.irfft(lines, steps, axis=0)
        return np.asarray(samples / samples.std(axis=0))
    turn = np.arange(steps) * axes // steps  # one axis after the other
    since = time - np.array([time[turn == axis][0] for axis in range(axes)])[turn]
    if kind == "squares":
        wave = np.where(since * random.uniform(8.0, 25.0) % 1.0 < 0.5, 1.0, -1.0)
    else:
        last, length = random.uniform(400.0, 1_500.0), steps * SAMPLE_TIME / axes
        wave = np.sin(2.0 * np.pi * (5.0 * since + 0.5 * (last - 5.0) / length * since**2))
    return np.asarray(wave[:, np.newaxis] * (turn[:, np.newaxis] == np.arange(axes)))


def model_in_innovations_form(loop: LinearLoop) -> StateSpaceModel:
    """The plant of a loop with the gain of its stationary Kalman filter; computed in um, which rounds less."""
    force, axes = UM * loop.force * loop.force_noise, loop.axes
    noise = np.eye(axes) * (UM * loop.sensor_noise) ** 2
    k = kalman_gain(loop.a, loop.c, force @ force.T, noise, np.zeros((len(loop.a), axes)))
    return named(model_of(loop.a, loop.b, loop.c, k, np.eye(axes) * loop.sensor_noise**2))


def named(model: StateSpaceModel) -> StateSpaceModel:
    """With the names of `draw_data`."""
    count = len(model.c)
    names = [f"{axis + 1}" for axis in range(count)]
    return replace(
        model, input_names=tuple(f"i_{name}" for name in names), output_names=tuple(f"x_{name}" for name in names),
        input_units=("A",) * count, output_units=("m",) * count, method="given",
    )  # fmt: skip


def wrong_model(kind: str, bearing: Bearing, random: np.random.Generator) -> StateSpaceModel | None:
    """A wrong model of a bearing with the noise of the truth; None where the bearing cannot have this fault."""
    more = float(random.choice([-1.0, 1.0]))
    axes, true = bearing.axes, bearing.true_model()
    if kind == "gain":
        gains = np.full(axes, 1.0 + 0.1 * more)
        if random.random() < 0.5:
            gains[1:] = 1.0
        return model_in_innovations_form(bearing.loop(gains))
    if kind == "stiffness":
        return replace(bearing, stiffness=bearing.stiffness * (1.0 + 0.1 * more)).true_model()
    if kind == "mode":
        return replace(bearing, frequency=bearing.frequency * (1.0 + 0.05 * more)).true_model()
    if kind == "order":
        return model_in_innovations_form(bearing.loop(with_mode=False))
    if kind == "other bearing":
        other = replace(draw_bearing(random, axes), sensor_noise=bearing.sensor_noise, force_noise=bearing.force_noise)
        return other.true_model()
    if kind == "delay":
        n = len(true.a)
        a = block_diag(true.a, np.zeros((axes, axes)))
        a[:n, n:] = true.b
        by_input = np.vstack([np.zeros((n, axes)), np.eye(axes)])
        by_noise = np.vstack([true.k, np.zeros((axes, axes))])
        return named(replace(
            true, a=a, b=by_input, c=np.hstack([true.c, np.zeros((axes, axes))]), k=by_noise,
            initial_state=np.zeros(n + axes),
        ))  # fmt: skip
    if kind == "sign":
        return named(replace(true, b=-true.b))
    if axes < 2:
        return None
    order = np.roll(np.arange(axes), 1)
    return named(replace(true, b=true.b[:, order]))


def oracle(true: StateSpaceModel, wrong: StateSpaceModel, data: IdentificationData) -> float:
    """Twice the logarithm of the likelihood ratio of the true and the wrong model of these data.

    Both have the covariance of innovations that suits them best.
    """
    sizes = []
    for model in (true, wrong):
        errors = predict(model, data).residuals[0]
        sizes.append(np.linalg.slogdet(errors.T @ errors / len(errors))[1])
    return float(data.samples * (sizes[1] - sizes[0]))
