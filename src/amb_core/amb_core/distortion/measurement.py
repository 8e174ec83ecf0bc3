"""Best linear approximation, noise and nonlinear distortions from the response to random-phase multisines.

With the Fourier transforms R of the reference, U of the control current and Y of the position over a period, a column
for each of the two experiments of a realisation, the reference is the instrument that opens the loop:

    T = mean(Y R^-1),    S = mean(U R^-1),    G = T S^-1

T is the best linear approximation of the closed loop from reference to position, G that of the plant, means over the
realisations. What differs from period to period is noise; what is the same in every period but not T R is distortion:
at lines that are not excited it is there by itself (fast method), at excited lines it differs between realisations
(robust method).

Source: R. Pintelon and J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., Wiley, 2012,
chapter 4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.distortion.signals import Lines
from amb_core.errors import SpectrumError

_INDEPENDENT = 1e-6  # ratio of the singular values of the references of a realisation


@dataclass(frozen=True)
class PeriodicResponse:
    """The response to one experiment in the steady state.

    Attributes
    ----------
    reference : ndarray, shape (steps, 2)
        One period of the reference, x and y (m).
    current, position : ndarray, shape (periods, steps, 2)
        Control currents (A) and positions (m) over consecutive periods.
    """

    reference: NDArray[np.float64]
    current: NDArray[np.float64]
    position: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Distortion:
    """Linear response, noise and distortions of the position; levels are peak amplitudes of lines in one experiment.

    Attributes
    ----------
    frequency, odd_frequency, even_frequency : ndarray
        Frequencies of the excited lines, of the odd lines that are not, and of the even lines (Hz).
    closed_loop : ndarray, shape (excited, 2, 2)
        T: from the references x, y to the positions x, y (-).
    deviation : ndarray, shape (excited, 2, 2)
        Standard deviation of T from noise and distortions together.
    plant : ndarray, shape (excited, 2, 2)
        G: from the control currents x, y to the positions x, y (m/A).
    linear : ndarray, shape (excited, 2)
        The linear response T R, root mean square over the experiments (m).
    stochastic : ndarray, shape (excited, 2)
        Distortions at the excited lines (m).
    odd, even : ndarray, shapes (odd, 2), (even, 2)
        Distortions at the odd and even lines that are not excited (m).
    noise : ndarray, shape (excited, 2)
        Noise at the excited lines, of the mean over the periods (m).
    ratio : ndarray, shape (2,)
        Root mean square of all distortions over that of the linear response, x and y (-).
    odd_ratio, even_ratio, noise_ratio : ndarray, shape (2,)
        The parts of odd and even order, and the noise of one period, likewise.
    """

    frequency: NDArray[np.float64]
    odd_frequency: NDArray[np.float64]
    even_frequency: NDArray[np.float64]
    closed_loop: NDArray[np.complex128]
    deviation: NDArray[np.float64]
    plant: NDArray[np.complex128]
    linear: NDArray[np.float64]
    stochastic: NDArray[np.float64]
    odd: NDArray[np.float64]
    even: NDArray[np.float64]
    noise: NDArray[np.float64]
    ratio: NDArray[np.float64]
    odd_ratio: NDArray[np.float64]
    even_ratio: NDArray[np.float64]
    noise_ratio: NDArray[np.float64]

    @property
    def decibel(self) -> NDArray[np.float64]:
        """`ratio` in dB, shape (2,); minus infinity where no distortion was found."""
        with np.errstate(divide="ignore"):
            return np.asarray(20.0 * np.log10(self.ratio))

    @property
    def summary(self) -> str:
        """One line for people."""
        parts = [
            f"{axis} {100.0 * ratio:.2g} % ({level:.0f} dB; even {100.0 * even:.2g} %, odd {100.0 * odd:.2g} %)"
            for axis, ratio, level, even, odd in zip(
                "xy", self.ratio, self.decibel, self.even_ratio, self.odd_ratio, strict=True
            )
        ]
        return f"nonlinear distortion over the linear response: {', '.join(parts)}"


def measure_distortion(responses: Sequence[Sequence[PeriodicResponse]], lines: Lines, sample_time: float) -> Distortion:
    """Measure the distortions of a loop.

    Parameters
    ----------
    responses : sequence of pairs of PeriodicResponse
        The two experiments of each realisation, of two realisations or more, all with as many periods, two or more.
    lines : Lines
        Which lines are excited and which are not.
    sample_time : float
        Sample time (s).

    Raises
    ------
    SpectrumError
        If there are too few realisations or periods, a value is not finite, or the references of a realisation do not
        excite the two axes independently at an excited line.
    """
    if len(responses) < 2 or any(len(pair) != 2 for pair in responses):
        raise SpectrumError("distortions need two realisations or more, of two experiments each")
    if min(len(item.position) for pair in responses for item in pair) < 2:
        raise SpectrumError("distortions need two periods or more of every experiment; one shows no noise")
    reference, current, position = (
        np.array([[_amplitudes(getattr(item, name)) for item in pair] for pair in responses])
        for name in ("reference", "current", "position")
    )  # realisation, experiment, (period,) line, axis
    if not (np.isfinite(reference).all() and np.isfinite(current).all() and np.isfinite(position).all()):
        raise SpectrumError("a reference, current or position is not finite")
    realisations, experiments, periods = position.shape[:3]
    mean = position.mean(axis=2)
    noise = position.var(axis=2, ddof=1).mean(axis=(0, 1)) / periods

    by_line = reference[:, :, lines.excited].transpose(0, 2, 3, 1)  # realisation, line, axis, experiment
    strengths = np.linalg.svd(by_line, compute_uv=False)
    weak = ~(strengths[..., -1] > _INDEPENDENT * strengths.max())
    if weak.any():
        line = lines.excited[np.argwhere(weak)[0, 1]]
        frequency = line / (lines.steps * sample_time)
        raise SpectrumError(f"the references do not excite x and y independently at {frequency:g} Hz")
    opened = np.linalg.inv(by_line)
    each = mean[:, :, lines.excited].transpose(0, 2, 3, 1) @ opened
    closed_loop = each.mean(axis=0)
    to_current = (current.mean(axis=2)[:, :, lines.excited].transpose(0, 2, 3, 1) @ opened).mean(axis=0)

    linear = (closed_loop @ by_line).transpose(0, 3, 1, 2)  # realisation, experiment, line, axis
    rest = np.abs(mean[:, :, lines.excited] - linear) ** 2
    stochastic = rest.sum(axis=(0, 1)) / (experiments * (realisations - 1)) - noise[lines.excited]
    odd, even = ((np.abs(mean[:, :, kind]) ** 2).mean(axis=(0, 1)) - noise[kind] for kind in (lines.odd, lines.even))
    response = (np.abs(linear) ** 2).mean(axis=(0, 1))
    total = response.sum(axis=0)
    of_odd, of_even = odd.sum(axis=0) + stochastic.sum(axis=0), even.sum(axis=0)
    every: NDArray[np.float64] = np.arange(lines.steps) / (lines.steps * sample_time)
    return Distortion(
        frequency=every[lines.excited],
        odd_frequency=every[lines.odd],
        even_frequency=every[lines.even],
        closed_loop=closed_loop,
        deviation=np.sqrt(each.var(axis=0, ddof=1) / realisations),
        plant=closed_loop @ np.linalg.inv(to_current),
        linear=np.sqrt(response),
        stochastic=_root(stochastic),
        odd=_root(odd),
        even=_root(even),
        noise=np.sqrt(noise[lines.excited]),
        ratio=_root((of_odd + of_even) / total),
        odd_ratio=_root(of_odd / total),
        even_ratio=_root(of_even / total),
        noise_ratio=np.sqrt(periods * noise[1 : max(lines.excited[-1], lines.even[-1]) + 1].sum(axis=0) / total),
    )


def _amplitudes(signal: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Complex peak amplitudes over the last but one axis; that of the mean is twice it."""
    steps = signal.shape[-2]
    return np.asarray(np.fft.rfft(signal, axis=-2) * (2.0 / steps))


def _root(power: NDArray[np.float64]) -> NDArray[np.float64]:
    """Square root; zero where less was found than the noise lets expect."""
    return np.sqrt(np.maximum(power, 0.0))
