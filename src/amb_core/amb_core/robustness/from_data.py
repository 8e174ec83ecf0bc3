"""A certificate from recorded data: the uncertainty of the model, its validation, what was measured, and the verdict.

`amb certify`, the service `identifier/certify` and `amb report --certify` all come here, so they give one answer.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from amb_core.errors import AmbError, RobustnessError
from amb_core.identification.data import IdentificationData
from amb_core.identification.data import RecordedLoop as Recorded
from amb_core.identification.uncertainty import ModelUncertainty, estimate_uncertainty
from amb_core.identification.validation import Validation, validate
from amb_core.identification.validation.overlap import fingerprint_of
from amb_core.loop.known_controller import KnownController, LinearControl
from amb_core.model import StateSpaceModel
from amb_core.robustness.certificate import Certificate, certify
from amb_core.robustness.feedback import is_same_law
from amb_core.robustness.measured import MeasuredSensitivity, measured_sensitivity
from amb_core.robustness.settings import RobustnessSettings


def certify_from_data(
    model: StateSpaceModel,
    law: KnownController,
    identified_from: Recorded | None = None,
    judged_on: Recorded | None = None,
    *,
    settings: RobustnessSettings | None = None,
    inputs: Mapping[str, str] | None = None,
    validation: Validation | None = None,
    uncertainty: ModelUncertainty | None = None,
    swept: Recorded | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Certificate:
    """Certify a model and a controller with the data that there are.

    Parameters
    ----------
    model : StateSpaceModel
        The identified model.
    law : KnownController
        The controller to certify; it may differ from that of the experiments.
    identified_from : Recorded, optional
        What the model was identified from, for its uncertainty. Without it nothing is certified.
    judged_on : Recorded, optional
        What the model is validated on; by default `identified_from`.
    settings : RobustnessSettings, optional
        What is assumed and demanded.
    inputs : mapping, optional
        Name and SHA-256 of everything that was read.
    validation, uncertainty : Validation, ModelUncertainty, optional
        Where they are known already; otherwise they are computed from the data.
    swept : Recorded, optional
        A swept sine on the running loop: its measured peak is checked too. By default the measured sensitivity is taken
        from the data of the validation, and shown only.
    progress : callable, optional
        Called with the name of each stage.

    Raises
    ------
    AmbError
        If model, controller and data do not fit together.
    """
    judged = judged_on or identified_from
    displacement: dict[str, float] = {}
    measured: MeasuredSensitivity | None = None
    remarks: tuple[str, ...] = ()
    if uncertainty is None and identified_from is not None:
        progress("uncertainty of the model")
        uncertainty = _uncertainty(model, identified_from.data)
    if judged is not None:
        if validation is None:
            progress("validating")
            known = model
            if identified_from is not None and not len(model.fingerprint):  # of an old file
                known = replace(model, fingerprint=fingerprint_of(identified_from.data))
            validation = validate(known, judged.data, judged.controller, uncertainty=uncertainty)
        if swept is None:
            try:
                measured = _measured(judged, law)
            except AmbError as problem:
                remarks = (f"sensitivity not measured: {problem}",)
        displacement = _displacement(judged)
    if swept is not None:
        progress("swept sine")
        measured = replace(_measured(swept, law), checked=True)
    progress("margins, worst cases and bounds")
    found = certify(
        model, law, settings=settings, validation=validation, uncertainty=uncertainty, inputs=inputs,
        measured=measured, displacement=displacement,
    )  # fmt: skip
    return replace(found, warnings=(*found.warnings, *remarks))


def _uncertainty(model: StateSpaceModel, data: IdentificationData) -> ModelUncertainty:
    """With the measured scatter of the innovations where they are not white."""
    found = estimate_uncertainty(model, data)
    return found if found.white else estimate_uncertainty(model, data, robust=True)


def _measured(loop: Recorded, law: KnownController) -> MeasuredSensitivity:
    """Measured sensitivity of the loop to certify; RobustnessError if it was another loop."""
    if loop.controller is None:
        raise RobustnessError("the controller of the experiment is not known")
    if not is_same_law(loop.controller.at_rate(loop.data.sample_rate), law, len(loop.data.output_names)):
        raise RobustnessError("the experiment had another controller than the one to certify")
    return measured_sensitivity(loop.data, loop.controller)


def _displacement(loop: Recorded) -> dict[str, float]:
    """Largest displacement over clearance, where the parameters of the plant are known."""
    if loop.plant is None:
        return {}
    clearance = loop.plant.rotor.backup_bearing_radius
    largest = np.max([np.abs(item.outputs).max(axis=0) for item in loop.data.experiments], axis=0)
    return {name: float(value / clearance) for name, value in zip(loop.data.output_names, largest, strict=True)}


def sha256_of_model(model: StateSpaceModel) -> str:
    """SHA-256 of the matrices of a model that is in no file, and of its sample time."""
    arrays = (model.a, model.b, model.c, model.d, model.k, model.innovation_covariance, np.array(model.sample_time))
    return _sha256(arrays)


def sha256_of_data(data: IdentificationData) -> str:
    """SHA-256 of the samples of data that are in no file, and of their sample time."""
    signals = [
        signal
        for item in data.experiments
        for signal in (item.inputs, item.outputs, item.reference)
        if signal is not None
    ]
    return _sha256((*signals, np.array(data.sample_time)))


def sha256_of_controller(controller: KnownController) -> str:
    """SHA-256 of a controller that is in no file: of its matrices, or of its parameters as JSON."""
    if isinstance(controller, LinearControl):
        return sha256_of_model(controller.model)
    return hashlib.sha256(json.dumps(controller.model_dump(), sort_keys=True).encode()).hexdigest()


def _sha256(arrays: tuple[np.ndarray, ...]) -> str:
    found = hashlib.sha256()
    for array in arrays:
        found.update(f"{array.shape}".encode())
        found.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
    return found.hexdigest()
