"""Frequency responses of models and measured ones, with their accuracy where it is known."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri, stdtrit

from amb_core.ground.errors import IdentificationError
from amb_core.ground.given_values import numbers, require_kind
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.linear.resolvent import outputs_by_state, parts_of, states_by_input

LEVEL = 0.99
"""Default confidence of bands."""

_POLE = "the model has a pole at {} Hz, where its response is infinite; choose other frequencies"
_AT_NYQUIST = 1.0 + 1e-9  # tolerance for rounding of a frequency at the Nyquist frequency


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Response from m inputs to p outputs over frequency; arrays are read-only.

    Attributes
    ----------
    frequency : ndarray, shape (f,)
        Frequencies (Hz), ascending, not negative.
    response : ndarray of complex, shape (f, p, m)
        Output over input (units of the signals; m/A for the magnetic bearing).
    label : str
        Name for legends.
    magnitude_deviation : ndarray, shape (f, p, m), or None
        Standard deviation of the magnitude, in the unit of the response. None if not known.
    phase_deviation : ndarray, shape (f, p, m), or None
        Standard deviation of the phase (rad). None if not known.
    coherence : ndarray, shape (f, p), or None
        Squared multiple coherence of each output with the excitation of the loop, 0 to 1 (-). None if not known.
    input_names, output_names, input_units, output_units : tuple of str
        Names and units of the signals.
    free_terms : float or None
        Independent complex terms from which the deviations are estimated, minus those that the response itself uses
        (-). None if the deviations are known, as those of a model.

    Raises
    ------
    IdentificationError
        If shapes do not fit together, the frequencies do not ascend, a value is not finite or `free_terms` not
        positive.
    """

    frequency: NDArray[np.float64]
    response: NDArray[np.complex128]
    label: str = ""
    magnitude_deviation: NDArray[np.float64] | None = None
    phase_deviation: NDArray[np.float64] | None = None
    coherence: NDArray[np.float64] | None = None
    input_names: tuple[str, ...] = ("i_x", "i_y")
    output_names: tuple[str, ...] = ("x", "y")
    input_units: tuple[str, ...] = ("A", "A")
    output_units: tuple[str, ...] = ("m", "m")
    free_terms: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "frequency", checked_frequencies(self.frequency))
        for name in ("input_names", "output_names", "input_units", "output_units"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        f, p, m = len(self.frequency), len(self.output_names), len(self.input_names)
        self._freeze("response", (f, p, m), np.complex128)
        for name in ("magnitude_deviation", "phase_deviation"):
            if getattr(self, name) is not None:
                self._freeze(name, (f, p, m), np.float64)
        if self.coherence is not None:
            self._freeze("coherence", (f, p), np.float64)
        if len(self.input_units) != m or len(self.output_units) != p:
            raise IdentificationError(f"{m} inputs and {p} outputs need as many units")
        if self.free_terms is not None and not 0.0 < self.free_terms < np.inf:
            raise IdentificationError(
                f"'free_terms' = {self.free_terms} is not allowed; allowed: more than 0, finite, or None"
            )

    @property
    def magnitude(self) -> NDArray[np.float64]:
        """Magnitude, in the unit of the response, shape (f, p, m)."""
        return np.abs(self.response)

    @property
    def phase(self) -> NDArray[np.float64]:
        """Phase (rad), -pi to pi at the first frequency and continuous above it, shape (f, p, m)."""
        return np.unwrap(np.angle(self.response), axis=0)

    def half_width(self, level: float = LEVEL) -> float:
        """Half the width of a band at a confidence, in standard deviations (-).

        That of a normal distribution; if the deviations are estimated from few terms, that of Student's t with the
        degrees of freedom of their real and imaginary parts.

        Parameters
        ----------
        level : float, optional
            Confidence of the band (-), between 0 and 1.

        Returns
        -------
        float
            The half width (-).
        """
        normal = normal_quantile(level)
        return normal if self.free_terms is None else float(stdtrit(2.0 * self.free_terms, 0.5 + 0.5 * level))

    def magnitude_band(self, level: float = LEVEL) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Lower and upper end of the magnitude at a confidence, shape (f, p, m); None where the deviation is unknown.

        The band is symmetric about the logarithm of the magnitude, so the lower end is positive.

        Parameters
        ----------
        level : float, optional
            Confidence of the band (-), between 0 and 1.

        Returns
        -------
        tuple of ndarray, shapes (f, p, m), or None
            Lower and upper end, in the unit of the response.
        """
        if self.magnitude_deviation is None:
            return None
        magnitude = np.maximum(self.magnitude, np.finfo(float).tiny)
        with np.errstate(over="ignore"):  # if the response is not known at all
            factor = np.exp(self.half_width(level) * self.magnitude_deviation / magnitude)
        return magnitude / factor, magnitude * factor

    def phase_band(self, level: float = LEVEL) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Lower and upper end of the phase (rad) at a confidence, shape (f, p, m); None where the deviation is unknown.

        It is at most the whole circle, half of it to either side.

        Parameters
        ----------
        level : float, optional
            Confidence of the band (-), between 0 and 1.

        Returns
        -------
        tuple of ndarray, shapes (f, p, m), or None
            Lower and upper end (rad).
        """
        if self.phase_deviation is None:
            return None
        half = np.minimum(self.half_width(level) * self.phase_deviation, np.pi)
        return self.phase - half, self.phase + half

    def _freeze(self, name: str, shape: tuple[int, ...], kind: type[np.generic]) -> None:
        array = np.array(getattr(self, name), dtype=kind)
        if array.shape != shape:
            raise IdentificationError(f"'{name}' has shape {array.shape}; {shape} is needed")
        if not np.all(np.isfinite(array)):
            raise IdentificationError(f"'{name}' holds values that are not finite")
        array.flags.writeable = False
        object.__setattr__(self, name, array)


class HasModel(Protocol):
    """What has a model, such as the result of an identification."""

    @property
    def model(self) -> StateSpaceModel:
        """The model."""


def response_of(model: StateSpaceModel | HasModel, frequencies: ArrayLike, label: str = "") -> FrequencyResponse:
    """The frequency response of a model, C (z I - A)^-1 B + D at z = exp(2 pi i f T); it may be unstable.

    Parameters
    ----------
    model : StateSpaceModel or Identification
        The model, or the result of `identify`.
    frequencies : array_like, shape (f,)
        Frequencies (Hz), ascending, from 0 to half the sample rate.
    label : str, optional
        For legends; by default the method and the order.

    Returns
    -------
    FrequencyResponse
        The response at these frequencies, without deviations.

    Raises
    ------
    IdentificationError
        If a frequency is not allowed, or the model has a pole at it; or it is no model.
    """
    given, model = model, getattr(model, "model", model)
    if not isinstance(model, StateSpaceModel):
        raise IdentificationError(
            f"model: {type(given).__name__} is not allowed; allowed: the result of identify, or a StateSpaceModel; "
            "files: StateSpaceModel.load(path)"
        )
    require_kind("label", label, str, "a text", IdentificationError)
    frequency = checked_frequencies(frequencies, model.sample_time)
    response = model.response(frequency)
    at_pole = ~np.isfinite(response).all(axis=(1, 2))
    if at_pole.any():
        raise IdentificationError(_POLE.format(", ".join(f"{at:g}" for at in frequency[at_pole])))
    return FrequencyResponse(
        frequency,
        response,
        label or f"{model.method}, order {model.order}".lstrip(", "),
        input_names=model.input_names,
        output_names=model.output_names,
        input_units=model.input_units,
        output_units=model.output_units,
    )


def transfers(
    model: StateSpaceModel, frequency: NDArray[np.float64], b: NDArray[np.float64]
) -> Iterator[tuple[slice, NDArray[np.complex128], NDArray[np.complex128]]]:
    """In parts: which frequencies, C R and R b at them, shapes (part, p, n) and (part, n, columns), R = (z I - A)^-1.

    `b` has shape (n, columns): B, K or both.

    Raises
    ------
    IdentificationError
        If the model has a pole at a frequency.
    """
    points = np.exp(2j * np.pi * frequency * model.sample_time)
    for part in parts_of(points, model.order):
        try:
            by_input = states_by_input(model.a, b, points[part])
            by_state = outputs_by_state(model.a, model.c, points[part])
        except np.linalg.LinAlgError:
            raise IdentificationError(
                _POLE.format(f"a frequency between {frequency[part][0]:g} and {frequency[part][-1]:g}")
            ) from None
        yield part, by_state, by_input


def checked_frequencies(frequencies: ArrayLike, sample_time: float = 0.0) -> NDArray[np.float64]:
    """A read-only array of frequencies (Hz), up to the Nyquist frequency if the sample time (s) is given.

    Raises
    ------
    IdentificationError
        If there is none, or they do not ascend, are negative or above the Nyquist frequency.
    """
    frequency = np.array(numbers("frequencies", frequencies, IdentificationError))
    if frequency.ndim != 1 or not len(frequency) or not np.all(np.isfinite(frequency)):
        raise IdentificationError(f"frequencies must be a row of finite numbers, not of shape {frequency.shape}")
    if frequency[0] < 0.0 or np.any(np.diff(frequency) <= 0.0):
        raise IdentificationError("frequencies must ascend, from 0 Hz on")
    if sample_time and frequency[-1] > 0.5 / sample_time * _AT_NYQUIST:
        raise IdentificationError(
            f"a frequency of {frequency[-1]:g} Hz is not allowed; allowed: 0 to {0.5 / sample_time:g} Hz, half the "
            "sample rate"
        )
    frequency.flags.writeable = False
    return frequency


def normal_quantile(level: float) -> float:
    """Standard deviations to either side of the mean that contain a share of a normal distribution.

    Raises
    ------
    IdentificationError
        If the share does not lie between 0 and 1.
    """
    if not 0.0 < level < 1.0:
        raise IdentificationError(f"a confidence of {level} is not allowed; it must lie between 0 and 1")
    return float(ndtri(0.5 + 0.5 * level))
