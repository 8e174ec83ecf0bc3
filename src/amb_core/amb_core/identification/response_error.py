"""The largest relative error of an identified frequency response, entry by entry, against a computed one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import IdentificationError
from amb_core.identification.frequency_response import checked_frequencies, response_of
from amb_core.linear import LinearSystem
from amb_core.linear.model.state_space import StateSpaceModel

BAND = (5.0, 1000.0)
"""Hz."""
FLOOR = 0.01
"""Magnitude of an entry, over the largest entry at the same frequency, up to which it is not compared."""
POINTS = 500


@dataclass(frozen=True, eq=False)
class ResponseError:
    """|G_id - G_lin| / |G_lin|, for every entry that is compared.

    Attributes
    ----------
    frequency : ndarray, shape (f,)
        Frequencies (Hz).
    relative : ndarray, shape (f, p, m)
        Relative error (-); NaN where the entry is too small to be compared.
    input_names, output_names : tuple of str
        Names of the columns and rows.
    """

    frequency: NDArray[np.float64]
    relative: NDArray[np.float64]
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]

    @property
    def largest(self) -> float:
        """Largest relative error (-) of all entries and frequencies."""
        return float(np.nanmax(self.relative))

    @property
    def entries(self) -> NDArray[np.float64]:
        """Largest relative error (-) of each entry, shape (p, m); NaN for one that is nowhere compared."""
        largest = np.where(np.isnan(self.relative), -np.inf, self.relative).max(axis=0)
        return np.where(np.isneginf(largest), np.nan, largest)

    @property
    def worst(self) -> str:
        """Where the largest error is, as text."""
        place = np.unravel_index(int(np.nanargmax(self.relative)), self.relative.shape)
        line, row, column = (int(number) for number in place)
        return (
            f"{100.0 * self.largest:.3g} % at {self.frequency[line]:.4g} Hz, "
            f"from {self.input_names[column]} to {self.output_names[row]}"
        )


def response_error(
    model: StateSpaceModel,
    computed: LinearSystem,
    band: tuple[float, float] = BAND,
    floor: float = FLOOR,
    points: int = POINTS,
) -> ResponseError:
    """Compare the response of a model with a computed one on a logarithmic grid of frequencies.

    Relative errors of entries that are nearly zero say nothing, so an entry is compared at a frequency only where its
    computed magnitude exceeds `floor` times the largest entry at this frequency.

    Parameters
    ----------
    model : StateSpaceModel
        Identified, m inputs and p outputs.
    computed : LinearSystem
        Discrete, with as many: `linearize(plant, controller).discrete`.
    band : tuple of float, optional
        Lowest and highest frequency (Hz), up to half the sample rate.
    floor : float, optional
        Smallest magnitude that is compared, over the largest at the same frequency; less than 1.
    points : int, optional
        Number of frequencies.

    Raises
    ------
    IdentificationError
        If the two have different numbers or names of inputs and outputs, a frequency is not allowed, or a pole lies at
        one of them.
    """
    _check_names("inputs", model.input_names, computed.input_names)
    _check_names("outputs", model.output_names, computed.output_names)
    if not 0.0 <= floor < 1.0:
        raise IdentificationError(f"floor = {floor:g} is not allowed; allowed: 0 to less than 1")
    frequency = checked_frequencies(np.geomspace(*band, points), max(model.sample_time, computed.sample_time))
    truth = computed.response(frequency)
    response = response_of(model, frequency).response
    magnitude = np.abs(truth)
    compared = magnitude > floor * magnitude.max(axis=(1, 2), keepdims=True)
    relative = np.full(truth.shape, np.nan)
    relative[compared] = np.abs(response - truth)[compared] / magnitude[compared]
    return ResponseError(frequency, relative, model.input_names, model.output_names)


def _check_names(kind: str, identified: tuple[str, ...], computed: tuple[str, ...]) -> None:
    """Refuse other counts, and the same names in another order; names of its own do not matter."""
    if len(identified) != len(computed) or (identified != computed and set(identified) & set(computed)):
        raise IdentificationError(
            f"the identified model has the {kind} {', '.join(identified)}, the computed one {', '.join(computed)}; "
            "needed: the same number, in the same order"
        )
