"""Sensitivity measured on a running loop, as ISO 14839-3 describes: inject a signal and take the ratio.

The excitation is added to the reference, in front of the controller. With e = r - y behind the sum, S = e/r; for
several axes, excited one after the other or independently, S is a matrix. This is the sensitivity of a controller of
errors. One that treats reference and position differently has another loop at the reference than at the position; then
the response of the plant is measured and the known controller completes it.

A periodic reference is averaged over its periods; any other one, a swept sine above all, is taken by the local
polynomial method, which has no bias by leakage and transients, and about narrow resonances with a mode (`sharp_peaks`)
where that is asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks
from scipy.special import ndtri

from amb_core.data.experiments import IdentificationData
from amb_core.data.experiments.dataset import require_data
from amb_core.ground.errors import RobustnessError
from amb_core.identification.given import required_controller
from amb_core.identification.nonparametric import NonparametricEstimate, estimate_over_periods
from amb_core.linear import Arrays, Complexes, LinearSystem
from amb_core.loop.known_controller import KnownController, LinearControl
from amb_core.robustness.feedback import Feedback, law_from_positions
from amb_core.robustness.local_response import LocalResponse, local_response
from amb_core.robustness.sharp_peaks import SharpMode, with_sharp_peaks

FREQUENCIES = 400  # of the curve of a reference without period
CLOSER = 8  # times as close, about peaks
STANDS_OUT = 0.5  # dB, of a peak
_CLEAR = 5.0  # standard deviations by noise, of the same
COHERENT = 0.9  # coherence from which a measured value counts
KNOWN = 0.0115  # relative, standard deviation (0.1 dB), of a measured value that is compared with a model
LARGEST_ERROR = 0.3  # relative, standard deviation, of what is shown
_METHODS = {True: "ratio of error and reference", False: "measured plant and known controller"}


@dataclass(frozen=True, eq=False)
class MeasuredSensitivity:
    """A measured output sensitivity.

    Attributes
    ----------
    axes : tuple of str
        Names of the axes.
    frequency : ndarray, shape (f,)
        Frequencies (Hz).
    response : ndarray of complex, shape (f, p, p)
        S_o (-).
    deviation : ndarray, shape (f, p)
        Standard deviation of the magnitude of S of each axis by noise (-).
    coherence : ndarray, shape (f, p)
        Of each position with the references (-).
    method : str
        How it was measured.
    checked : bool
        Whether it is from a measurement made for it, whose peak a certificate checks.
    """

    axes: tuple[str, ...]
    frequency: Arrays
    response: Complexes
    deviation: Arrays
    coherence: Arrays
    method: str
    checked: bool = False

    @property
    def own(self) -> Complexes:
        """S of each axis, shape (f, p)."""
        return np.diagonal(self.response, axis1=1, axis2=2)

    def comparable(self, highest: float = 1_000.0) -> NDArray[np.bool_]:
        """Frequencies up to one (Hz) at which S of all axes is coherent and known to 0.1 dB; shape (f,).

        Parameters
        ----------
        highest : float, optional
            Highest frequency (Hz).

        Returns
        -------
        ndarray of bool, shape (f,)
            True at these frequencies.
        """
        known = (self.coherence >= COHERENT) & (self.deviation <= KNOWN * np.abs(self.own))
        return np.asarray((self.frequency <= highest) & np.all(known, axis=1))

    def difference_db(self, feedback: Feedback, highest: float = 1_000.0) -> Arrays:
        """Measured over computed magnitude of S in dB, shape (p, f'), at the comparable frequencies.

        Parameters
        ----------
        feedback : Feedback
            Loop of the model.
        highest : float, optional
            Highest frequency (Hz).

        Returns
        -------
        ndarray, shape (p, f')
            Differences (dB), positive where the measured value is larger.
        """
        kept = self.comparable(highest)
        model = np.abs(np.diagonal(feedback.output_sensitivity.response(self.frequency[kept]), axis1=1, axis2=2))
        return np.asarray(20.0 * np.log10(np.abs(self.own[kept]) / model).T)

    def peak(self, axis: int, confidence: float = 0.99) -> tuple[float, float]:
        """Upper end of the confidence interval of an axis's largest S where it is coherent, and its frequency.

        Infinite where no frequency is coherent.

        Parameters
        ----------
        axis : int
            Index of the axis.
        confidence : float, optional
            Confidence of the interval (-), between 0 and 1.

        Returns
        -------
        tuple of float
            Upper end (-), and frequency (Hz).
        """
        upper = np.abs(self.own[:, axis]) + ndtri(confidence) * self.deviation[:, axis]
        upper = np.where(self.coherence[:, axis] >= COHERENT, upper, -np.inf)
        place = int(np.argmax(upper))
        return (float(upper[place]) if upper[place] > 0.0 else np.inf), float(self.frequency[place])


def measured_sensitivity(
    data: IdentificationData, controller: KnownController, modes: Sequence[SharpMode] | None = None
) -> MeasuredSensitivity:
    """The sensitivity that data of a loop show.

    Parameters
    ----------
    data : IdentificationData
        Experiments with reference, in which the axes were excited independently.
    controller : KnownController
        That of the experiments.
    modes : sequence of SharpMode, optional
        Narrow resonances that are measured at their peaks, as `sharp_modes` finds them in some seconds; not for a
        periodic reference. With them, even none, S is known closely about its own peaks too.

    Returns
    -------
    MeasuredSensitivity
        S at the frequencies at which the data determine it.

    Raises
    ------
    IdentificationError, ParameterError, RobustnessError
        If the controller is not one of the data's axes and sample rate, or the data have no reference or do not
        determine the response.
    """
    require_data(data)
    controller = required_controller(controller, data.sample_time)
    references = [item.reference for item in data.experiments if item.reference is not None]
    if len(references) < len(data.experiments):
        raise RobustnessError("the sensitivity needs data with the reference; record them with an excitation")
    by_errors = _of_errors(controller)
    law = law_from_positions(controller.at_rate(data.sample_rate), len(data.output_names))
    averaged = estimate_over_periods(_with_errors(data) if by_errors else data)
    sensitivity = (
        _over_bands(data, law, by_errors, modes) if averaged is None else _over_periods(averaged, law, by_errors)
    )
    known = np.all(sensitivity.deviation <= LARGEST_ERROR * np.abs(sensitivity.own), axis=1)
    if not known.any():
        raise RobustnessError(
            "the data do not determine the sensitivity at any frequency; use a larger or longer excitation of each axis"
        )
    return replace(
        sensitivity,
        frequency=sensitivity.frequency[known],
        response=sensitivity.response[known],
        deviation=sensitivity.deviation[known],
        coherence=sensitivity.coherence[known],
    )


def _with_errors(data: IdentificationData) -> IdentificationData:
    """The data with the control errors in place of the inputs."""
    return replace(
        data,
        experiments=tuple(replace(item, inputs=_less(item.reference, item.outputs)) for item in data.experiments),
    )


def _over_periods(estimate: NonparametricEstimate, law: LinearSystem, by_errors: bool) -> MeasuredSensitivity:
    """From the response of the plant, or that of the positions to the errors, averaged over periods."""
    eye = np.eye(estimate.response.response.shape[1])
    if by_errors:
        right: Complexes = np.broadcast_to(eye.astype(complex), estimate.response.response.shape)
    else:
        right = law.response(estimate.response.frequency)
    sensitivity = np.linalg.inv(eye + estimate.response.response @ right)
    # dS = -S dL S: independent errors of the elements of the estimate.
    size, behind = np.abs(sensitivity) ** 2, np.abs(right @ sensitivity) ** 2
    variance = np.diagonal(size @ estimate.variance @ behind, axis1=1, axis2=2)
    coherence = estimate.response.coherence
    assert coherence is not None
    return MeasuredSensitivity(
        tuple(estimate.response.output_names),
        estimate.response.frequency,
        sensitivity.astype(np.complex128),
        np.sqrt(0.5 * variance),
        coherence,
        f"{_METHODS[by_errors]}; {estimate.response.label}",
    )


def experiments_of(data: IdentificationData) -> list[tuple[Arrays, Arrays]]:
    """References and all signals of each experiment."""
    return [
        (item.reference, np.hstack([item.inputs, item.outputs]))
        for item in data.experiments
        if item.reference is not None
    ]


def _over_bands(
    data: IdentificationData, law: LinearSystem, by_errors: bool, modes: Sequence[SharpMode] | None
) -> MeasuredSensitivity:
    """By the local polynomial method."""
    experiments = experiments_of(data)
    longest = max(len(reference) for reference, _ in experiments) * data.sample_time
    wanted = np.geomspace(1.0 / longest, 0.5 / data.sample_time, FREQUENCIES + 1)[:-1]
    local = local_response(experiments, data.sample_time, wanted)
    if modes is not None:
        closer = _about_peaks(_from_response(local, data, law, by_errors))
        if len(closer):
            local = local.joined(local_response(experiments, data.sample_time, closer))
        local = with_sharp_peaks(local, experiments, data.sample_time, modes)
    return _from_response(local, data, law, by_errors)


def _about_peaks(measured: MeasuredSensitivity) -> Arrays:
    """Frequencies (Hz) between those measured, about the peaks of S of each axis; ascending."""
    tops = np.unique([top for axis in range(len(measured.axes)) for top in peaks(measured, axis)]).astype(int)
    gaps = np.unique(np.concatenate([tops - 1, tops]))
    below, above = measured.frequency[gaps, np.newaxis], measured.frequency[gaps + 1, np.newaxis]
    return np.asarray((below * (above / below) ** (np.arange(1, CLOSER) / CLOSER)).ravel())


def peaks(measured: MeasuredSensitivity, axis: int) -> NDArray[np.int_]:
    """Indices of the peaks of S of an axis that stand out of their noise, the highest last; ends are none."""
    size = np.abs(measured.own[:, axis])
    tops, about = find_peaks(20.0 * np.log10(size), prominence=STANDS_OUT)
    noise = 20.0 / np.log(10.0) * measured.deviation[tops, axis] / size[tops]
    clear = tops[about["prominences"] > _CLEAR * noise]
    return clear[np.argsort(size[clear])]


def _from_response(
    local: LocalResponse, data: IdentificationData, law: LinearSystem, by_errors: bool
) -> MeasuredSensitivity:
    """From the response of inputs and outputs to the references."""
    m, eye = len(data.input_names), np.eye(len(data.output_names))
    if by_errors:  # S = I - Y, with the response Y of the positions
        sensitivity: Complexes = eye - local.response[:, m:]
        noise: Complexes = local.noise[:, m:, m:]
        right: Complexes = np.broadcast_to(eye.astype(complex), sensitivity.shape)
    else:  # S = (I + G C)^-1, G = Y U^-1, dG = (dY - G dU) U^-1
        to_inputs = np.linalg.inv(local.response[:, :m])
        plant = local.response[:, m:] @ to_inputs
        control = law.response(local.frequency)
        sensitivity = np.asarray(np.linalg.inv(eye + plant @ control))
        left = sensitivity @ np.concatenate([-plant, np.broadcast_to(eye, sensitivity.shape)], axis=2)
        noise = left @ local.noise @ np.conj(np.swapaxes(left, 1, 2))
        right = to_inputs @ control @ sensitivity
    spread = np.swapaxes(right, 1, 2) @ local.spread @ np.conj(right)
    variance = (np.diagonal(part, axis1=1, axis2=2).real for part in (noise, spread))
    return MeasuredSensitivity(
        tuple(data.output_names),
        local.frequency,
        sensitivity.astype(np.complex128),
        np.sqrt(0.5 * np.prod(list(variance), axis=0)),
        local.coherence[:, m:],
        f"{_METHODS[by_errors]}; local polynomials over frequency",
    )


def _of_errors(controller: KnownController) -> bool:
    """Whether a controller acts on r - y alone."""
    if isinstance(controller, LinearControl):
        return len(controller.model.input_names) == len(controller.model.output_names)
    on = controller.derivative_on
    return on == "error" if isinstance(on, str) else all(one == "error" for one in on)


def _less(reference: Arrays | None, outputs: Arrays) -> Arrays:
    assert reference is not None
    return np.asarray(reference - outputs)
