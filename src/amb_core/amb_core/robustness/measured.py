"""Sensitivity measured on a running loop, as ISO 14839-3 describes: inject a signal and take the ratio.

The excitation is added to the reference, in front of the controller. With e = r - y behind the sum, S = e/r; for
several axes, excited one after the other or independently, S is a matrix. It is estimated as (1 + L)^-1 from the loop
L = y/e, by the estimator of frequency responses, which gives coherence and deviations too. This is the sensitivity of
a controller of errors. One that treats reference and position differently has another loop at the reference than at the
position; then the response of the plant is measured and the known controller completes it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from amb_core.errors import RobustnessError
from amb_core.identification.data import IdentificationData
from amb_core.identification.nonparametric import estimate_response
from amb_core.loop.known_controller import KnownController, LinearControl
from amb_core.robustness.feedback import Feedback
from amb_core.robustness.lti import Arrays, Complexes


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
        S_o.
    deviation : ndarray, shape (f, p)
        Standard deviation of the magnitude of S of each axis by noise.
    coherence : ndarray, shape (f, p)
        Of each position with the references.
    method : str
        How it was measured.
    """

    axes: tuple[str, ...]
    frequency: Arrays
    response: Complexes
    deviation: Arrays
    coherence: Arrays
    method: str

    def difference_db(self, feedback: Feedback, highest: float = 1_000.0, coherent: float = 0.9) -> Arrays:
        """Measured over computed magnitude of S in dB, shape (p, f'), at coherent frequencies up to one (Hz)."""
        kept = (self.frequency <= highest) & np.all(self.coherence >= coherent, axis=1)
        model = np.abs(np.diagonal(feedback.output_sensitivity.response(self.frequency[kept]), axis1=1, axis2=2))
        return np.asarray(20.0 * np.log10(np.abs(np.diagonal(self.response[kept], axis1=1, axis2=2)) / model).T)


def measured_sensitivity(
    data: IdentificationData, controller: KnownController, feedback: Feedback
) -> MeasuredSensitivity:
    """The sensitivity that data of a loop show.

    Parameters
    ----------
    data : IdentificationData
        Experiments with reference, in which the axes were excited independently.
    controller : KnownController
        That of the experiments.
    feedback : Feedback
        Its loop with a model; of it only the controller is used, where it is not one of errors.

    Raises
    ------
    IdentificationError, RobustnessError
        If the data have no reference or do not determine the response.
    """
    if any(item.reference is None for item in data.experiments):
        raise RobustnessError("the sensitivity needs data with the reference; record them with an excitation")
    by_errors = _of_errors(controller)
    if by_errors:
        errors = [replace(item, inputs=_less(item.reference, item.outputs)) for item in data.experiments]
        found = estimate_response(replace(data, experiments=tuple(errors)))
        right: Complexes = np.broadcast_to(np.eye(len(data.output_names), dtype=complex), found.response.response.shape)
    else:
        found = estimate_response(data)
        right = feedback.controller.response(found.response.frequency)
    eye = np.eye(len(data.output_names))
    sensitivity = np.linalg.inv(eye + found.response.response @ right)
    # dS = -S dL S: independent errors of the elements of the estimate.
    size, behind = np.abs(sensitivity) ** 2, np.abs(right @ sensitivity) ** 2
    variance = np.diagonal(size @ found.variance @ behind, axis1=1, axis2=2)
    coherence = found.response.coherence
    assert coherence is not None
    method = "ratio of error and reference" if by_errors else "measured plant and known controller"
    return MeasuredSensitivity(
        tuple(data.output_names),
        found.response.frequency,
        sensitivity.astype(np.complex128),
        np.sqrt(0.5 * variance),
        coherence,
        f"{method}; {found.response.label}",
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
