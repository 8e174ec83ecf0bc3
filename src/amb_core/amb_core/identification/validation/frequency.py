"""The model's frequency response compared with one estimated without a model, and with that of the linearised plant.

Differences are in the spectral norm, relative to the response that the model is compared with, at each frequency: in
percent of the gain of the plant there, for any direction of the inputs.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from amb_core.data.controller_choice import needs_controller
from amb_core.data.experiments import IdentificationData
from amb_core.data.experiments.checks import check_feedback
from amb_core.ground.errors import IdentificationError, ParameterError, PlantError
from amb_core.identification.frequency_response import LEVEL, FrequencyResponse, response_of
from amb_core.identification.nonparametric import NonparametricEstimate, estimate_response
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.loop.control import ControllerParameters
from amb_core.loop.known_controller import KnownController, LinearControl

if TYPE_CHECKING:
    from amb_core.identification.uncertainty import ModelUncertainty
    from amb_core.plant import PlantParameters

_LOWEST = 1e-4  # of the sample rate: 1 Hz at 10 kHz
_POINTS = 500


@dataclass(frozen=True)
class BandComparison:
    """The model's response in a band of frequencies. All but the frequencies in percent; NaN for unknown values.

    Attributes
    ----------
    low, high : float
        The band, `high` not included (Hz).
    lines : int
        Frequencies in it at which there is an estimate.
    difference, largest : float
        Median and largest difference from the estimate (percent).
    deviation : float
        Median standard deviation of the estimate (percent): smaller differences cannot be seen.
    within : float
        Elements of the response that lie within the 99 % region of estimate and model (percent).
    plant_difference : float
        Median difference from the linearised plant (percent).
    """

    low: float
    high: float
    lines: int
    difference: float
    largest: float
    deviation: float
    within: float
    plant_difference: float


@dataclass(frozen=True, eq=False)
class FrequencyComparison:
    """Frequency responses of one plant, and how they differ.

    Attributes
    ----------
    model : FrequencyResponse
        Of the model; with deviations where its uncertainty is known.
    measured : NonparametricEstimate or None
        Estimated without a model; None where the data do not determine it.
    plant : FrequencyResponse or None
        Of the linearised plant, at the frequencies of the model's; None if the plant is not known.
    bands : tuple of BandComparison
        Differences over bands of half a decade.
    """

    model: FrequencyResponse
    measured: NonparametricEstimate | None
    plant: FrequencyResponse | None
    bands: tuple[BandComparison, ...]

    @property
    def responses(self) -> tuple[FrequencyResponse, ...]:
        """All available responses, to be drawn together."""
        measured = () if self.measured is None else (self.measured.response,)
        return (*measured, self.model, *(() if self.plant is None else (self.plant,)))


def compare_responses(
    model: StateSpaceModel,
    data: IdentificationData,
    controller: KnownController | None = None,
    uncertainty: ModelUncertainty | None = None,
    plant: PlantParameters | None = None,
) -> tuple[FrequencyComparison, list[str]]:
    """Compare the model's response with all known ones; notes show what is missing, and why.

    Parameters
    ----------
    model : StateSpaceModel
        The model.
    data : IdentificationData
        Data with the signals of the model.
    controller : KnownController, optional
        Controller that holds the rotor where the plant is linearised; by default the paper's.
    uncertainty : ModelUncertainty, optional
        Uncertainty of the model; without it there are no bands.
    plant : PlantParameters, optional
        The plant, if it is known; None otherwise.

    Returns
    -------
    (FrequencyComparison, list of str)
        The responses with their differences by band, and the notes.

    Raises
    ------
    IdentificationError
        If the model has a pole on the unit circle.
    """
    notes = []
    measured = None
    try:
        measured = estimate_response(data, open_loop=in_open_loop(data))
        notes += [f"frequency response: {note}" for note in measured.notes]
    except IdentificationError as problem:
        notes.append(f"frequency response without a model: left out: {problem}")
    at_lines = np.empty(0) if measured is None else measured.response.frequency
    nyquist = 0.5 / model.sample_time
    grid = np.union1d(np.geomspace(2.0 * nyquist * _LOWEST, nyquist, _POINTS), at_lines)
    label = f"model, {model.method or 'method unknown'}, order {model.order}"
    of_model = response_of(model, grid, label) if uncertainty is None else uncertainty.response(grid, label)
    linearised = None
    if plant is not None:
        try:
            linearised = response_of_plant(plant, controller, grid, _mean_output(data))
        except (ParameterError, PlantError) as problem:
            notes.append(f"frequency response of the plant: left out: {problem}")
    bands = tuple(_bands(of_model, measured, linearised))
    return FrequencyComparison(of_model, measured, linearised, bands), notes


def in_open_loop(data: IdentificationData) -> bool:
    """Whether nothing speaks for a controller: no reference, not the bearing's signals, no feedback in the data."""
    if needs_controller(data) or any(item.reference is not None for item in data.experiments):
        return False
    return not check_feedback(data).where


def _mean_output(data: IdentificationData) -> NDArray[np.float64]:
    return np.asarray(sum(item.outputs.sum(axis=0) for item in data.experiments) / data.samples)


def response_of_plant(
    parameters: PlantParameters,
    controller: KnownController | None,
    frequencies: NDArray[np.float64],
    position: NDArray[np.float64] | None = None,
) -> FrequencyResponse:
    """Response of the plant linearised at the operating point, from the control currents (A) to the positions (m).

    The PD controller gives the operating point; in the loop of another one it is `position` (m), shape (axes,).

    Raises
    ------
    PlantError
        If it cannot be linearised there, or has one axis only.
    """
    from amb_core.plant import Plant, linearize

    plant = Plant(parameters)
    if isinstance(controller, LinearControl):
        if position is None:
            raise PlantError("the operating point in the loop of a linear controller is not known")
        journal = position[: 2 * plant.bearings].reshape(-1, 2).mean(axis=0)  # the model has all at one place
        paper = ControllerParameters().at_rate(parameters.integration.sample_rate)
        discrete = linearize(plant, paper, journal).discrete
    else:
        discrete = linearize(plant, controller).discrete
    outputs = discrete.output_names
    if len(outputs) < 2:
        raise PlantError("the plant has one axis only")
    return FrequencyResponse(
        frequencies,
        discrete.response(frequencies),
        "plant, linearised",
        input_names=discrete.input_names,
        output_names=outputs,
        input_units=("A",) * len(outputs),
        output_units=("m",) * len(outputs),
    )


def _bands(
    model: FrequencyResponse, measured: NonparametricEstimate | None, plant: FrequencyResponse | None
) -> Iterator[BandComparison]:
    edges = np.sort(np.concatenate([10.0 ** np.arange(-3, 7), 3.0 * 10.0 ** np.arange(-3, 7)]))
    for low, high in itertools.pairwise(edges):
        on_grid = (model.frequency >= low) & (model.frequency < high)
        beside = np.empty(0)
        if plant is not None:
            beside = _relative(model.response[on_grid] - plant.response[on_grid], plant.response[on_grid])
        difference, deviation, inside = np.empty(0), np.empty(0), np.empty(0)
        if measured is not None:
            response = measured.response
            lines = (response.frequency >= low) & (response.frequency < high)
            here = np.searchsorted(model.frequency, response.frequency[lines])
            error = model.response[here] - response.response[lines]
            difference = _relative(error, response.response[lines])
            spread = np.sqrt(measured.variance[lines].sum(axis=(1, 2)))
            deviation = spread / np.linalg.norm(response.response[lines], ord=2, axis=(1, 2))
            variance = measured.variance[lines] + _variance(model)[here]
            inside = np.abs(error) ** 2 <= measured.largest_error(LEVEL) * variance
        if len(difference) or len(beside):
            yield BandComparison(
                float(low),
                float(high),
                len(difference),
                100.0 * _median(difference),
                100.0 * (float(difference.max()) if len(difference) else np.nan),
                100.0 * _median(deviation),
                100.0 * (float(inside.mean()) if inside.size else np.nan),
                100.0 * _median(beside),
            )


def _relative(difference: NDArray[np.complex128], response: NDArray[np.complex128]) -> NDArray[np.float64]:
    return np.asarray(np.linalg.norm(difference, ord=2, axis=(1, 2)) / np.linalg.norm(response, ord=2, axis=(1, 2)))


def _variance(response: FrequencyResponse) -> NDArray[np.float64]:
    """Variance of the complex error, shape (f, p, m); zero where it is not known."""
    if response.magnitude_deviation is None or response.phase_deviation is None:
        return np.zeros(response.response.shape)
    return response.magnitude_deviation**2 + (response.magnitude * response.phase_deviation) ** 2


def _median(values: NDArray[np.float64]) -> float:
    return float(np.median(values)) if len(values) else float("nan")
