"""Deviations of a plant from its model that a test can name: gains, dead times, stiffness, and the frequency of modes.

A gain, dead time or stiffness that is off by theta adds theta psi[k] to the one-step prediction errors e[k], to first
order:

    w[k+1] = (A - K C) w[k] + B v[k],    psi[k] = C w[k],

v being the input of the plant that the deviation is equivalent to: the input itself (gain), its last step back (dead
time of one sample), or the predicted position (stiffness). psi is known from past data. So, with e white and
independent of the past, the least-squares estimate of theta is normal around zero for a true model, feedback or not.
Past errors are regressors too: what they explain is a fault of the noise model, not of the plant.

The frequency of a mode is moved by steps, since e is not linear in it: the likelihood ratio of the best step.

Each kind is judged alone, as if the plant differed in nothing else. Its size is the error of the response that it makes
by the rule of `model_error`, relative to the limit at that frequency. The fault may be another of the same effect.

Sources: L. Ljung, System Identification, 2nd ed., Prentice Hall, 1999, sections 7.4 and 9.3; C. R. Rao, Linear
Statistical Inference and Its Applications, 2nd ed., Wiley, 1973, section 6e.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, special

from amb_core.data.experiments import IdentificationData
from amb_core.ground.errors import IdentificationError
from amb_core.identification.prediction import Prediction, filtered, predicted_states
from amb_core.identification.validation.model_error import column_sizes, limit_at
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.loop.known_controller import KnownController

Arrays = NDArray[np.float64]

PAST = 4
"""Errors of so many samples before are regressors."""
MOVES = (-0.1, -0.07, -0.05, -0.03, -0.015, 0.015, 0.03, 0.05, 0.07, 0.1)
"""Steps by which the frequency of a mode is moved, relative."""
_LIGHT = 0.1  # damping ratio of a mode at most
_DOMINANT = 0.3  # share of the errors that one direction explains
_STILL = 1e-12  # of psi relative to the errors, below which the data say nothing
_HIGHEST = 0.25  # of the sample rate, up to which the response is compared
_LOWEST = 1e-3
_BANDS = 40
_POINTS = 6  # of the response in each band


@dataclass(frozen=True)
class Deviation:
    """One kind of deviation, judged alone.

    Attributes
    ----------
    name, unit : str
        What deviates, and the unit of the values: `%` or `samples`.
    value, deviation : float
        Of the plant from the model, and its standard deviation, that of the model included; NaN for a mode.
    size : float
        Largest error of the response that it makes, relative to the limit there; above 1 it matters.
    p_value : float
        Probability of so large a value for a true model.
    """

    name: str
    unit: str
    value: float
    deviation: float
    size: float
    p_value: float

    @property
    def text(self) -> str:
        """In words."""
        spread = "" if math.isnan(self.deviation) else f" ± {self.deviation:.2g}"
        return f"{self.name}: {self.value:+.3g}{spread} {self.unit}"


@dataclass(frozen=True)
class _Direction:
    """A kind of deviation that is linear: of some columns of the inputs or outputs alike."""

    kind: str
    name: str
    unit: str
    scale: float
    columns: tuple[int, ...]


def find_deviations(
    model: StateSpaceModel,
    data: IdentificationData,
    prediction: Prediction,
    controller: KnownController | None = None,
) -> tuple[Deviation, ...]:
    """All kinds of which the data say anything, the least probable for a true model first."""
    bands = _Bands(model, controller)
    found = [*_linear(model, data, prediction, bands), *_modes(model, data, prediction, bands)]
    return tuple(sorted(found, key=lambda one: (one.p_value, -one.size)))


class _Bands:
    """Size of a change of the response relative to its limits."""

    def __init__(self, model: StateSpaceModel, controller: KnownController | None) -> None:
        rate = 1.0 / model.sample_time
        edges = np.geomspace(_LOWEST * rate, _HIGHEST * rate, _BANDS + 1)
        self.frequency = np.concatenate(
            [np.linspace(low, high, _POINTS, endpoint=False) for low, high in itertools.pairwise(edges)]
        )
        self.z = np.exp(2j * np.pi * self.frequency * model.sample_time)[:, np.newaxis, np.newaxis]
        self.response = model.response(self.frequency)
        self._limits = [limit_at(model, controller, middle) for middle in np.sqrt(edges[:-1] * edges[1:])]
        self._sizes = [column_sizes(part) for part in np.split(self.response, _BANDS)]

    def largest(self, change: NDArray[np.complex128]) -> float:
        """Largest error over the bands, relative to its limit."""
        parts = zip(np.split(change, _BANDS), self._sizes, self._limits, strict=True)
        return max(float(np.max(100.0 * column_sizes(part) / size / limit)) for part, size, limit in parts)


def _linear(
    model: StateSpaceModel, data: IdentificationData, prediction: Prediction, bands: _Bands
) -> Iterator[Deviation]:
    directions = list(_directions(model))
    errors, moved = [], []
    for item, state, residual in zip(data.experiments, prediction.first_states, prediction.residuals, strict=True):
        if len(residual) <= 2 * PAST * (residual.shape[1] + 1):
            continue
        u = item.inputs - model.input_offset
        x = predicted_states(model, u, item.outputs - model.output_offset, state)
        lagged = np.hstack([residual[PAST - lag : len(residual) - lag] for lag in range(1, PAST + 1)])
        past = np.hstack([lagged, np.ones((len(lagged), 1))])
        plain = np.hstack([residual, *(_effect(model, one, u, x) for one in directions)])[PAST:]
        rest = plain - past @ np.linalg.lstsq(past, plain, rcond=None)[0]
        plain = plain - plain.mean(axis=0)
        axes = residual.shape[1]
        errors.append((plain[:, :axes], rest[:, :axes]))
        moved.append(tuple(item[:, axes:].reshape(len(rest), -1, axes) for item in (plain, rest)))
    if not errors:
        return
    try:
        of_plain, of_rest = (
            _Along(np.vstack([item[place] for item in errors]), np.concatenate([item[place] for item in moved]))
            for place in range(2)
        )
    except linalg.LinAlgError:
        return
    variance = 1.0 + (data.samples / model.samples if model.samples else 0.0)
    for number, one in enumerate(directions):
        strength, along = of_rest.power[number], of_rest.product[number]
        if strength <= _STILL * of_rest.count:
            continue
        value, deviation = along / strength, math.sqrt(variance / strength)
        p_value = 2.0 * float(special.ndtr(-abs(value) / deviation))
        if of_plain.explained[number] > _DOMINANT:  # past errors, which are then of this kind, would hide it
            value = of_plain.product[number] / of_plain.power[number]
        size = bands.largest(value * _change(one, bands))
        yield Deviation(one.name, one.unit, one.scale * float(value), one.scale * deviation, size, p_value)


class _Along:
    """Products of errors with the effects of directions, all in units of the errors' covariance."""

    def __init__(self, errors: Arrays, effects: NDArray[np.float64]) -> None:
        factor = linalg.cholesky(errors.T @ errors / len(errors), lower=True)
        white = linalg.solve_triangular(factor, errors.T, lower=True).T
        psi = effects @ linalg.solve_triangular(factor, np.eye(len(factor)), lower=True).T
        self.count = white.size
        self.power, self.product = np.sum(psi**2, axis=(0, 2)), np.einsum("kdp,kp->d", psi, white)

    @property
    def explained(self) -> Arrays:
        """Share of the errors that each direction explains alone."""
        return np.asarray(self.product**2 / np.maximum(self.power, np.finfo(float).tiny) / self.count)


def _directions(model: StateSpaceModel) -> Iterator[_Direction]:
    inputs, outputs = model.input_names, model.output_names
    at_rest = np.abs(np.diag(model.response([_LOWEST / model.sample_time])[0]))
    for column, name in enumerate((*inputs, "all inputs")):
        columns = (column,) if column < len(inputs) else tuple(range(len(inputs)))
        if column < len(inputs) or column > 1:
            yield _Direction("gain", f"gain of {name}", "%", 100.0, columns)
            yield _Direction("dead time", f"dead time of {name}", "samples", 1.0, columns)
    if len(inputs) != len(outputs):
        return
    for column, name in enumerate((*outputs, "all axes")):
        columns = (column,) if column < len(outputs) else tuple(range(len(outputs)))
        if column < len(outputs) or column > 1:
            yield _Direction(
                "stiffness", f"stiffness of {name}", "%", 100.0 * float(at_rest[list(columns)].mean()), columns
            )


def _effect(model: StateSpaceModel, one: _Direction, u: Arrays, x: Arrays) -> Arrays:
    """Psi of a deviation of 1, shape (steps, p)."""
    columns = list(one.columns)
    signal = (x @ model.c.T if one.kind == "stiffness" else u)[:, columns]
    if one.kind == "dead time":
        signal = np.vstack([np.zeros(len(columns)), signal[:-1] - signal[1:]])
    return filtered(model, signal @ model.b[:, columns].T) @ model.c.T


def _change(one: _Direction, bands: _Bands) -> NDArray[np.complex128]:
    """Change of the response by a deviation of 1, to first order."""
    changed, columns = np.zeros_like(bands.response), list(one.columns)
    by_input = bands.response[:, :, columns]
    if one.kind == "stiffness":
        return np.asarray(by_input @ bands.response[:, columns, :])
    changed[:, :, columns] = by_input * (1.0 / bands.z - 1.0 if one.kind == "dead time" else 1.0)
    return changed


def _modes(
    model: StateSpaceModel, data: IdentificationData, prediction: Prediction, bands: _Bands
) -> Iterator[Deviation]:
    """Modes whose frequency another step explains the data better."""
    poles, right = np.linalg.eig(model.a)
    if np.linalg.cond(right) > 1e10:
        return
    left = np.linalg.inv(right)
    at_first = _log_size(prediction.residuals)
    variance = 1.0 + (data.samples / model.samples if model.samples else 0.0)
    for number, pole in enumerate(poles):
        if pole.imag <= 0.0:
            continue
        rate = np.log(pole)
        if abs(rate.real) > _LIGHT * abs(rate) or abs(rate) > 2.0 * np.pi * _HIGHEST:
            continue
        shape, best = np.outer(right[:, number], left[number]), (0.0, 0.0, model)
        for move in MOVES:
            change = np.exp(rate + 1j * move * rate.imag) - pole
            moved = replace(model, a=model.a + 2.0 * (change * shape).real)
            better = at_first - _log_size_of(moved, data, prediction)
            if better > best[0]:
                best = (better, move, moved)
        if best[0] > 0.0:
            p_value = min(1.0, len(MOVES) * float(special.chdtrc(1.0, data.samples * best[0] / variance)))
            frequency = abs(rate) / (2.0 * np.pi * model.sample_time)
            size = bands.largest(best[2].response(bands.frequency) - bands.response)
            yield Deviation(
                f"frequency of the mode at {frequency:.0f} Hz", "%", 100.0 * best[1], math.nan, size, p_value
            )


def _log_size(errors: tuple[Arrays, ...]) -> float:
    """Logarithm of the determinant of the covariance of errors."""
    samples = sum(map(len, errors))
    return float(np.linalg.slogdet(sum(part.T @ part for part in errors) / samples)[1])


def _log_size_of(model: StateSpaceModel, data: IdentificationData, prediction: Prediction) -> float:
    """The same of the prediction errors of a model; infinite where its predictor is unstable."""
    errors = []
    try:
        for item, state in zip(data.experiments, prediction.first_states, strict=True):
            u, y = item.inputs - model.input_offset, item.outputs - model.output_offset
            errors.append(y - predicted_states(model, u, y, state) @ model.c.T - u @ model.d.T)
    except IdentificationError:
        return math.inf
    return _log_size(tuple(errors))
