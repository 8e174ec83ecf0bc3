"""Deviations of a plant from its model that a test can name: gains, dead times, stiffness, and the frequency of modes.

A gain, dead time or stiffness that is off by theta adds theta psi[k] to the one-step prediction errors e[k], to first
order:

    w[k+1] = (A - K C) w[k] + B v[k],    psi[k] = C w[k],

v being the input of the plant that the deviation is equivalent to: the input itself (gain), its last step back (dead
time of one sample), or the predicted position (stiffness). psi is known from past data. So, with e white and
independent of the past, the least-squares estimate of theta is normal around zero for a true model, feedback or not.
Past errors are regressors too: what they explain is a fault of the noise model, not of the plant.

The frequency of a mode is moved by steps, since e is not linear in it: the likelihood ratio of the best step, after
what the linear kinds explain.

Alone, each kind explains some of what another does, and with a size of its own: a gain that is 3 % off looks like a
stiffness that is 5 % off. So they are taken one after the other, each time the one that explains most of what those
before leave, until none of the others explains more than chance. The size of those taken is the error of the response
that they make together by the rule of `model_error`, relative to the limit at that frequency. The fault may be another
of the same effect.

Sources: L. Ljung, System Identification, 2nd ed., Prentice Hall, 1999, sections 7.4 and 9.3; C. R. Rao, Linear
Statistical Inference and Its Applications, 2nd ed., Wiley, 1973, section 6e; A. J. Miller, Subset Selection in
Regression, 2nd ed., Chapman and Hall, 2002, section 3.2.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, special

from amb_core.data.experiments import IdentificationData
from amb_core.ground.errors import IdentificationError
from amb_core.identification.prediction import Prediction, filtered, predicted_states
from amb_core.identification.validation.model_error import column_sizes, limit_at, variance_of_estimate
from amb_core.identification.validation.verdict import SIGNIFICANT
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.loop.known_controller import KnownController

Arrays = NDArray[np.float64]

PAST = 4
"""Errors of so many samples before are regressors."""
MOVES = (-0.1, -0.07, -0.05, -0.03, -0.015, 0.015, 0.03, 0.05, 0.07, 0.1)
"""Steps by which the frequency of a mode is moved, relative."""
_LIGHT = 0.1  # damping ratio of a mode at most
_DOMINANT = 0.3  # share of the errors that one direction explains
_ALIKE = 1e-6  # power of a direction beyond others, relative to its own, below which it is the same
_STILL = 1e-12  # of psi relative to the errors, below which the data say nothing
_HIGHEST = 0.25  # of the sample rate, up to which the response is compared
_LOWEST = 1e-3
_BANDS = 40
_POINTS = 6  # of the response in each band


@dataclass(frozen=True)
class Deviation:
    """One kind of deviation.

    Attributes
    ----------
    name, unit : str
        What deviates, and the unit of the values: `%` or `samples`.
    value, deviation : float
        Of the plant from the model, and its standard deviation by the noise of these data; NaN for a mode.
    size : float
        Largest error of the response that it makes with those that are significant, relative to the limit there; above
        1 it matters.
    p_value : float
        Probability for a true model that it explains so much beyond those that explain more.
    p_estimated : float
        The same for a model that was estimated from as few samples as this one.
    """

    name: str
    unit: str
    value: float
    deviation: float
    size: float
    p_value: float
    p_estimated: float

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
    deviations, others = _linear(model, data, prediction, bands)
    deviations += _modes(model, data, prediction, bands, others)
    return tuple(sorted(deviations, key=lambda one: one.p_value))  # as they were taken, where it is 0


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


def effects_of(
    model: StateSpaceModel, data: IdentificationData, prediction: Prediction, index: int, steps: int
) -> Arrays:
    """What all kinds that are linear would do to the errors of an experiment, shape (steps, kinds p) or fewer steps."""
    item = data.experiments[index]
    u, y = item.inputs[:steps] - model.input_offset, item.outputs[:steps] - model.output_offset
    x = predicted_states(model, u, y, prediction.first_states[index])
    return np.hstack([_effect(model, one, u, x) for one in _directions(model)])


def _linear(
    model: StateSpaceModel, data: IdentificationData, prediction: Prediction, bands: _Bands
) -> tuple[list[Deviation], list[Arrays]]:
    """All linear kinds, and the effects of those that are significant on each experiment, shapes (steps, taken, p)."""
    directions, axes = list(_directions(model)), len(model.c)
    deviations: list[Deviation] = []
    effects = [effects_of(model, data, prediction, index, len(part)) for index, part in enumerate(prediction.residuals)]
    shaped = [part.reshape(len(part), -1, axes) for part in effects]
    products = _products(prediction, effects, axes)
    if products is None:
        return [], [part[:, :0] for part in shaped]
    of_plain, of_rest = products
    taken, explained = of_rest.taken()
    variance = variance_of_estimate(model, data)
    # Where they dominate the errors, past errors are of these kinds too, and would hide them.
    values = (of_plain if of_plain.explained(taken) > _DOMINANT else of_rest).values(taken)
    strength, along = of_rest.beyond(taken)
    together = bands.largest(_changed(directions, dict(zip(taken, values, strict=True)), bands))
    for number, one in enumerate(directions):
        if number in taken:
            place = taken.index(number)
            value, deviation, size, sigmas = values[place], of_rest.spread(taken)[place], together, explained[place]
        elif strength[number] > _STILL * of_rest.count:
            value, deviation = along[number] / strength[number], 1.0 / math.sqrt(strength[number])
            size = bands.largest(_changed(directions, {number: value}, bands))
            sigmas = float(of_rest.sigmas(taken)[number])
        else:
            continue
        p_value, p_estimated = (2.0 * float(special.ndtr(-sigmas / math.sqrt(scale))) for scale in (1.0, variance))
        deviations.append(
            Deviation(one.name, one.unit, one.scale * float(value), one.scale * deviation, size, p_value, p_estimated)
        )
    return deviations, [part[:, taken] for part in shaped]


def _products(prediction: Prediction, effects: list[Arrays], axes: int) -> tuple[_Along, _Along] | None:
    """Of the errors with the effects, and of what the past of the errors does not explain of both.

    None where no experiment is long enough, or an axis has no errors.
    """
    errors, moved = [], []
    for residual, effect in zip(prediction.residuals, effects, strict=True):
        if len(residual) <= 2 * PAST * (axes + 1):
            continue
        lagged = np.hstack([residual[PAST - lag : len(residual) - lag] for lag in range(1, PAST + 1)])
        past = np.hstack([lagged, np.ones((len(lagged), 1))])
        plain = np.hstack([residual, effect])[PAST:]
        rest = plain - past @ np.linalg.lstsq(past, plain, rcond=None)[0]
        plain = plain - plain.mean(axis=0)
        errors.append((plain[:, :axes], rest[:, :axes]))
        moved.append(tuple(item[:, axes:].reshape(len(rest), -1, axes) for item in (plain, rest)))
    if not errors:
        return None
    try:
        of_plain, of_rest = (
            _Along(np.vstack([item[place] for item in errors]), np.concatenate([item[place] for item in moved]))
            for place in range(2)
        )
    except linalg.LinAlgError:
        return None
    return of_plain, of_rest


class _Along:
    """Products of errors with the effects of directions, all in units of the errors' covariance."""

    def __init__(self, errors: Arrays, effects: NDArray[np.float64]) -> None:
        factor = linalg.cholesky(errors.T @ errors / len(errors), lower=True)
        white = linalg.solve_triangular(factor, errors.T, lower=True).T
        psi = effects @ linalg.solve_triangular(factor, np.eye(len(factor)), lower=True).T
        self.count = white.size
        by_direction = np.moveaxis(psi, 1, 0).reshape(psi.shape[1], -1)
        self.power, self.product = by_direction @ by_direction.T, by_direction @ white.ravel()

    def taken(self) -> tuple[list[int], list[float]]:
        """The directions that explain more than chance, the best first, and how much of each, see `sigmas`."""
        taken: list[int] = []
        explained: list[float] = []
        while len(taken) < len(self.product):
            sigmas = self.sigmas(taken)
            best = int(np.argmax(sigmas))
            if not len(self.product) * 2.0 * special.ndtr(-sigmas[best]) < SIGNIFICANT:
                break
            taken.append(best)
            explained.append(float(sigmas[best]))
        return taken, explained

    def sigmas(self, taken: list[int]) -> Arrays:
        """What each direction explains beyond those taken, in standard deviations of what a true model's errors do."""
        strength, along = self.beyond(taken)
        return np.asarray(np.abs(along) / np.sqrt(np.maximum(strength, np.finfo(float).tiny)))

    def beyond(self, taken: list[int]) -> tuple[Arrays, Arrays]:
        """Power of each direction, and its product with the errors, beyond those taken; 0 where nothing is left."""
        power, inner = self.power[:, taken], self.power[np.ix_(taken, taken)]
        share = np.linalg.solve(inner, power.T).T
        own = np.diag(self.power)
        strength = own - np.sum(share * power, axis=1)
        left = strength > np.maximum(_ALIKE * own, _STILL * self.count)
        return np.where(left, strength, 0.0), np.where(left, self.product - share @ self.product[taken], 0.0)

    def values(self, taken: list[int]) -> Arrays:
        """Deviations of the directions taken, together."""
        return np.asarray(np.linalg.solve(self.power[np.ix_(taken, taken)], self.product[taken]))

    def spread(self, taken: list[int]) -> Arrays:
        """Standard deviations of these values."""
        return np.asarray(np.sqrt(np.diag(np.linalg.inv(self.power[np.ix_(taken, taken)]))))

    def explained(self, taken: list[int]) -> float:
        """Share of the errors that the directions taken explain together."""
        return float(self.product[taken] @ self.values(taken) / self.count)


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


def _changed(directions: list[_Direction], values: dict[int, float], bands: _Bands) -> NDArray[np.complex128]:
    """Change of the response by deviations of these values."""
    by_input, feedback = bands.response.copy(), np.zeros(bands.response.shape[1])
    for number, value in values.items():
        one, columns = directions[number], list(directions[number].columns)
        if one.kind == "stiffness":
            feedback[columns] += value
        else:
            by_input[:, :, columns] *= 1.0 + value * (1.0 / bands.z - 1.0 if one.kind == "dead time" else 1.0)
    if feedback.any():  # the positions act on the inputs
        return np.asarray(np.linalg.solve(np.eye(len(feedback)) - by_input * feedback, by_input) - bands.response)
    return np.asarray(by_input - bands.response)


def _modes(
    model: StateSpaceModel,
    data: IdentificationData,
    prediction: Prediction,
    bands: _Bands,
    others: list[Arrays],
) -> Iterator[Deviation]:
    """Modes of which another frequency explains the data better, beyond what other kinds of these effects explain."""
    poles, right = np.linalg.eig(model.a)
    if np.linalg.cond(right) > 1e10:
        return
    left = np.linalg.inv(right)
    at_first = _log_size(prediction.residuals, others)
    variance = variance_of_estimate(model, data)
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
            better = at_first - _log_size_of(moved, data, prediction, others)
            if better > best[0]:
                best = (better, move, moved)
        if best[0] > 0.0:
            p_value, p_estimated = (
                min(1.0, len(MOVES) * float(special.chdtrc(1.0, data.samples * best[0] / scale)))
                for scale in (1.0, variance)
            )
            frequency = abs(rate) / (2.0 * np.pi * model.sample_time)
            size = bands.largest(best[2].response(bands.frequency) - bands.response)
            yield Deviation(
                f"frequency of the mode at {frequency:.0f} Hz", "%", 100.0 * best[1], math.nan, size, p_value,
                p_estimated,
            )  # fmt: skip


def _log_size(errors: Sequence[Arrays], effects: list[Arrays]) -> float:
    """Logarithm of the determinant of the covariance of what the effects leave of errors."""
    e, psi = np.vstack(errors), np.concatenate(effects)
    covariance = e.T @ e / len(e)
    if psi.shape[1]:
        white = linalg.cholesky(np.linalg.inv(covariance), lower=True)
        by_effect = np.moveaxis(psi @ white, 1, 0).reshape(psi.shape[1], -1)
        values = np.linalg.lstsq(by_effect @ by_effect.T, by_effect @ (e @ white).ravel(), rcond=None)[0]
        e = e - np.tensordot(psi, values, axes=(1, 0))
        covariance = e.T @ e / len(e)
    return float(np.linalg.slogdet(covariance)[1])


def _log_size_of(
    model: StateSpaceModel, data: IdentificationData, prediction: Prediction, effects: list[Arrays]
) -> float:
    """The same of the prediction errors of a model; infinite where its predictor is unstable."""
    errors = []
    try:
        for item, state in zip(data.experiments, prediction.first_states, strict=True):
            u, y = item.inputs - model.input_offset, item.outputs - model.output_offset
            errors.append(y - predicted_states(model, u, y, state) @ model.c.T - u @ model.d.T)
        return _log_size(errors, effects)
    except (IdentificationError, linalg.LinAlgError):
        return math.inf
