"""Best linear approximation, noise and nonlinear distortions from the response to periodic references.

With the Fourier transforms R of the reference, U of the control current and Y of the position over a period, a column
for each experiment, the reference is the instrument that opens the loop:

    T = Y R^H (R R^H)^-1,    S = U R^H (R R^H)^-1,    G = T S^-1

T is the best linear approximation of the closed loop from reference to position, G that of the plant, by least squares
over the experiments. A steady drift is removed first. What then differs from period to period is noise; what is the
same in every period but not T R is distortion: at lines that are not excited it is there by itself (fast method), at
excited lines it differs between realisations (robust method).

Source: R. Pintelon and J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., Wiley, 2012,
chapter 4; for the local fit of few experiments, section 7.2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import special

from amb_core.ground.errors import SpectrumError
from amb_core.regions.distortion.drift import without_drift
from amb_core.regions.distortion.local_fit import fit_between_lines
from amb_core.regions.distortion.records import moving, require_motion
from amb_core.regions.distortion.result import Distortion, Method
from amb_core.regions.distortion.signals import Lines

INDEPENDENT = 1e-6
"""Smallest singular value of the references at a line over the largest one of all lines."""
CONFIDENCE = 0.95
"""Of the upper bound of the distortion of the class."""
Values = NDArray[np.float64]
T = TypeVar("T", np.float64, np.complex128)
V = TypeVar("V", np.int_, np.float64)
_SMOOTHED = 5  # neighbouring lines that are not excited, whose mean power stands for an excited one's


@dataclass(frozen=True)
class PeriodicResponse:
    """The response to one experiment in the steady state.

    Attributes
    ----------
    reference : ndarray, shape (steps, axes)
        One period of the reference (m).
    current, position : ndarray, shape (periods, steps, axes)
        Control currents (A) and positions (m) over consecutive periods.
    """

    reference: NDArray[np.float64]
    current: NDArray[np.float64]
    position: NDArray[np.float64]


def measure_distortion(responses: Sequence[Sequence[PeriodicResponse]], lines: Lines, sample_time: float) -> Distortion:
    """Measure the distortions of the loop of a bearing of two axes, x and y.

    Parameters
    ----------
    responses : sequence of pairs of PeriodicResponse
        The two experiments of each realisation, of two realisations or more, with two periods or more.
    lines : Lines
        Which lines are excited and which are not.
    sample_time : float
        Sample time (s).

    Returns
    -------
    Distortion
        Linear response, distortions and noise by the robust method.

    Raises
    ------
    SpectrumError
        If there are too few realisations or periods, a value is not finite, a position stands still while its reference
        moves, or the references of a realisation do not excite the two axes independently at an excited line.
    """
    if len(responses) < 2 or any(len(pair) != 2 for pair in responses):
        raise SpectrumError("distortions need two realisations or more, of two experiments each")
    check_responses([item for pair in responses for item in pair])
    for pair in responses:
        by_line = np.stack([_amplitudes(item.reference)[lines.excited] for item in pair], axis=-1)
        weak = _dependent(by_line)
        if weak.any():
            frequency = lines.excited[np.argmax(weak)] / (lines.steps * sample_time)
            raise SpectrumError(f"the references do not excite x and y independently at {frequency:g} Hz")
    return distortion_of([item for pair in responses for item in pair], lines, sample_time)


def distortion_of(
    experiments: Sequence[PeriodicResponse], lines: Lines, sample_time: float, axes: Sequence[str] = ("x", "y")
) -> Distortion:
    """Measure the distortions from experiments whose references are realisations of one kind of signal.

    With more experiments than axes excited at once, distortions at excited lines are measured (robust method).
    Otherwise they are taken from the lines beside them that are not excited (fast method).

    Parameters
    ----------
    experiments : sequence of PeriodicResponse
        The experiments, with two periods or more each.
    lines : Lines
        Which lines are excited and which are not.
    sample_time : float
        Sample time (s).
    axes : sequence of str
        Names of the axes.

    Raises
    ------
    SpectrumError
        If there are too few periods, a value is not finite, a position stands still while its reference moves, or
        neither method can be used.
    """
    check_responses(experiments, axes)
    averages = _averages(experiments)
    mean, noise = averages.position, averages.noise
    at = lines.excited
    each = sum(  # of the distortion, for every experiment: at the lines that are not excited, and below at the others
        (np.abs(mean[:, kind]) ** 2).sum(axis=1) - noise[kind].sum(axis=0) for kind in (lines.odd, lines.even)
    )
    y, u = (np.moveaxis(part[:, at], 0, -1) for part in (mean, averages.current))
    r, excited, independent = _moving(experiments, np.moveaxis(averages.reference[:, at], 0, -1))
    columns = r.shape[1]  # r: line, moving axis or direction, experiment
    by_lines = not _dependent(r).any()
    method: Method = "robust" if by_lines and len(experiments) > columns else "fast"
    complete = method == "robust" or _shows_all(lines)
    odd, even = ((np.abs(mean[:, kind]) ** 2).mean(axis=0) - noise[kind] for kind in (lines.odd, lines.even))
    best = _approximation(at, r, y, u, by_lines)
    closed_loop = best.closed_loop
    if method == "robust":
        powers = _by_realisations(closed_loop @ r, y, noise[at], columns)
        each = each + powers.each - noise[at].sum(axis=0)
    else:
        stochastic = _beside(lines, odd, even) if complete else np.zeros((len(at), y.shape[1]))
        powers = _by_lines_beside(stochastic, y, noise[at])
    response, stochastic = powers.response, powers.stochastic
    total = response.sum(axis=0)
    total = np.where(excited & (total > 0.0), total, np.nan)
    of_odd, of_even = odd.sum(axis=0) + stochastic.sum(axis=0), even.sum(axis=0)
    separate = 1.0 if only_odd(lines) else np.nan
    error = np.maximum(powers.spread, best.left)
    variance = error[:, :, np.newaxis] * np.einsum("lii->li", best.weights).real[:, np.newaxis, :]
    unknown = np.full_like(y[..., :1] * excited, np.nan)
    every: NDArray[np.float64] = np.arange(lines.steps) / (lines.steps * sample_time)
    last = max(int(part[-1]) for part in (lines.excited, lines.odd, lines.even) if len(part))
    return Distortion(
        axes=tuple(axes),
        frequency=every[at],
        odd_frequency=every[lines.odd],
        even_frequency=every[lines.even],
        closed_loop=_spread_out(closed_loop, excited) if independent else unknown,
        deviation=_spread_out(np.sqrt(variance), excited) if independent else unknown.real,
        plant=closed_loop @ _inverse(best.to_current) if excited.all() and independent else unknown,
        linear=np.sqrt(response),
        stochastic=_root(stochastic),
        odd=_root(odd),
        even=_root(even),
        noise=np.sqrt(noise[at]),
        ratio=_root((of_odd + of_even) / total),
        upper_ratio=_root((of_odd + of_even + _beyond_mean(np.asarray(each), columns)) / total),
        odd_ratio=separate * _root(of_odd / total) if complete else np.full_like(total, np.nan),
        even_ratio=separate * _root(of_even / total),
        noise_ratio=np.sqrt(averages.period_noise[1 : last + 1].sum(axis=0) / total),
        method=method,
        complete=complete,
        experiments=len(experiments),
        periods=min(len(item.position) for item in experiments),
        period=lines.steps * sample_time,
    )


def _moving(
    experiments: Sequence[PeriodicResponse], reference: NDArray[np.complex128]
) -> tuple[NDArray[np.complex128], NDArray[np.bool_], bool]:
    """References that move independently; which axes have one, and whether it is each axis' own.

    `reference` has the shape (lines, axes, experiments).
    """
    together = np.concatenate([item.reference for item in experiments])
    excited = moving(together)
    reference = reference[:, excited]
    directions = _directions(together[:, excited])
    if len(directions) == reference.shape[1]:
        return reference, excited, True
    return np.asarray(directions @ reference), excited, False  # as those of a rigid mode, some move only together


def _beyond_mean(power: Values, together: int) -> Values:
    """Upper confidence bound of the mean of powers, shape (experiments, axes), less the mean that they have.

    Experiments with references of one realisation are taken together; their powers are not independent.
    """
    count = len(power) // together
    if count < 2:
        return np.full(power.shape[1], np.nan)
    means = power[: count * together].reshape(count, together, -1).mean(axis=1)
    return np.asarray(special.stdtrit(count - 1, CONFIDENCE) * means.std(axis=0, ddof=1) / np.sqrt(count))


@dataclass(frozen=True)
class _Averages:
    """Amplitudes of all experiments, shape (experiments, lines, axes), and the power of the noise, (lines, axes).

    Those of position and current are means over the periods; `noise` is that of these means, `period_noise` that of a
    single period.
    """

    reference: NDArray[np.complex128]
    current: NDArray[np.complex128]
    position: NDArray[np.complex128]
    noise: Values
    period_noise: Values


def _averages(experiments: Sequence[PeriodicResponse]) -> _Averages:
    position = [_amplitudes(without_drift(item.position)) for item in experiments]  # of each: period, line, axis
    return _Averages(
        reference=np.stack([_amplitudes(item.reference) for item in experiments]),
        current=np.stack([_amplitudes(without_drift(item.current)).mean(axis=0) for item in experiments]),
        position=np.stack([periods.mean(axis=0) for periods in position]),
        noise=np.mean([periods.var(axis=0, ddof=1) / len(periods) for periods in position], axis=0),
        period_noise=np.mean([periods.var(axis=0, ddof=1) for periods in position], axis=0),
    )


@dataclass(frozen=True)
class _Approximation:
    """Best linear approximations T and S at the excited lines, the weights of their errors, and what a fit leaves."""

    closed_loop: NDArray[np.complex128]
    to_current: NDArray[np.complex128]
    weights: NDArray[np.complexfloating]
    left: Values


def _approximation(
    at: NDArray[np.int_],
    r: NDArray[np.complex128],
    y: NDArray[np.complex128],
    u: NDArray[np.complex128],
    by_lines: bool,
) -> _Approximation:
    """From amplitudes of shape (lines, signals, experiments), line by line or by a fit over neighbouring lines."""
    if by_lines:
        weights = np.linalg.inv(r @ _conjugate(r))
        opened = _conjugate(r) @ weights
        return _Approximation(y @ opened, u @ opened, weights, np.zeros((len(at), y.shape[1])))
    fit = fit_between_lines(at, r, np.concatenate([y, u], axis=1))
    left = np.diagonal(fit.noise, axis1=1, axis2=2).real[:, : y.shape[1]]
    return _Approximation(fit.response[:, : y.shape[1]], fit.response[:, y.shape[1] :], fit.weights, left)


@dataclass(frozen=True)
class _Powers:
    """At the excited lines, shape (lines, axes): linear response, what differs from it, and the distortion in that.

    `each` is the power that differs in every experiment, noise included, shape (experiments, axes), where it is known.
    """

    response: Values
    spread: Values
    stochastic: Values
    each: Values | float = 0.0


def _by_realisations(fitted: NDArray[np.complex128], y: NDArray[np.complex128], noise: Values, columns: int) -> _Powers:
    """Robust method: what differs between realisations of the reference is noise and distortion."""
    experiments = y.shape[-1]
    spread = (np.abs(y - fitted) ** 2).sum(axis=-1) / (experiments - columns)
    left_over = experiments / (experiments - columns)
    each = (left_over * np.abs(y - fitted) ** 2).sum(axis=0).T
    return _Powers((np.abs(fitted) ** 2).mean(axis=-1), spread, spread - noise, each)


def _by_lines_beside(stochastic: Values, y: NDArray[np.complex128], noise: Values) -> _Powers:
    """Fast method: distortions at an excited line have the power that they have beside it."""
    spread = np.maximum(stochastic, 0.0) + noise
    return _Powers(np.maximum((np.abs(y) ** 2).mean(axis=-1) - spread, 0.0), spread, stochastic)


def check_responses(experiments: Sequence[PeriodicResponse], axes: Sequence[str] = ("x", "y")) -> None:
    """Require two periods or more of finite samples, and positions that move where their references do.

    Raises
    ------
    SpectrumError
        If an experiment is otherwise.
    """
    if min(len(item.position) for item in experiments) < 2:
        raise SpectrumError("distortions need two periods or more of every experiment; one shows no noise")
    if not all(np.isfinite(part).all() for item in experiments for part in vars(item).values()):
        raise SpectrumError("a reference, current or position is not finite")
    for item in experiments:
        require_motion(axes, item.reference, item.position)


def only_odd(lines: Lines) -> bool:
    """Whether only odd lines are excited, so that products of even and of odd order share no line."""
    return bool(np.all(lines.excited % 2 == 1))


def _dependent(references: NDArray[np.complex128]) -> NDArray[np.bool_]:
    """Lines, shape (lines,), at which the references of several experiments do not separate the axes."""
    if references.shape[-1] < references.shape[-2]:
        return np.ones(len(references), dtype=bool)
    strengths = np.linalg.svd(references, compute_uv=False)
    return np.asarray(~(strengths[..., -1] > INDEPENDENT * strengths.max()))


def _directions(references: Values) -> Values:
    """Orthonormal directions, shape (n, axes), in which references (steps, axes) move."""
    _, strengths, directions = np.linalg.svd(np.linalg.qr(references - references.mean(axis=0), mode="r"))
    return np.asarray(directions[strengths > INDEPENDENT * strengths[0]])


def _shows_all(lines: Lines) -> bool:
    """Whether distortions of every order show at lines in the band that are not excited.

    Raises
    ------
    SpectrumError
        If those of no order do.
    """
    unexcited, _ = _seen(lines, lines.odd, lines.even)
    if len(unexcited) >= 2:
        return True
    if only_odd(lines) and len(lines.even):
        return False
    raise SpectrumError("every line of the band is excited, so distortion hides in the response to the reference")


def _seen(lines: Lines, odd: NDArray[V], even: NDArray[V]) -> tuple[NDArray[np.int_], NDArray[V]]:
    """Lines in the band on which what is at the excited ones shows by itself, and a value at each."""
    unexcited, values = lines.odd, odd
    if not only_odd(lines):  # products of every order fall on every line
        unexcited = np.concatenate([lines.odd, lines.even])
        order = np.argsort(unexcited)
        unexcited, values = unexcited[order], np.concatenate([odd, even])[order]
    inside = (unexcited > lines.excited[0]) & (unexcited < lines.excited[-1])
    return unexcited[inside], values[inside]


def _beside(lines: Lines, odd: Values, even: Values) -> Values:
    """Power of distortions at the excited lines, from lines beside them on which they show by themselves."""
    unexcited, power = _seen(lines, odd, even)
    window = np.ones(min(_SMOOTHED, len(unexcited)))
    share = np.convolve(np.ones(len(unexcited)), window, "same")
    smooth = np.stack([np.convolve(column, window, "same") / share for column in power.T])
    return np.stack([np.interp(lines.excited, unexcited, column) for column in smooth], axis=-1)


def _inverse(matrices: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Inverses of a stack of matrices; NaN for those that have none, as where a current does not move."""
    inverses = np.full_like(matrices, np.nan)
    regular = np.linalg.cond(matrices) < 1.0 / np.finfo(np.float64).eps
    inverses[regular] = np.linalg.inv(matrices[regular])
    return inverses


def _spread_out(matrices: NDArray[T], moving: NDArray[np.bool_]) -> NDArray[T]:
    """Matrices with columns for all references; NaN for those that do not move."""
    full = np.full((*matrices.shape[:2], len(moving)), np.nan, dtype=matrices.dtype)
    full[:, :, moving] = matrices
    return full


def _conjugate(matrices: NDArray[np.complex128]) -> NDArray[np.complex128]:
    return np.asarray(np.swapaxes(matrices.conj(), -1, -2))


def _amplitudes(signal: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Complex peak amplitudes over the last but one axis; that of the mean is twice it."""
    steps = signal.shape[-2]
    return np.asarray(np.fft.rfft(signal, axis=-2) * (2.0 / steps))


def _root(power: NDArray[np.float64]) -> NDArray[np.float64]:
    """Square root; zero where there is less power than the noise alone has."""
    return np.sqrt(np.maximum(power, 0.0))
