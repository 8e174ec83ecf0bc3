"""A certificate from recorded data: the uncertainty of the model, its validation, what was measured, and the verdict.

`amb certify`, the service `identifier/certify` and `amb report --certify` all come here, so they give one answer.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from amb_core.errors import AmbError, RobustnessError
from amb_core.identification.data import IdentificationData
from amb_core.identification.data import RecordedLoop as Recorded
from amb_core.identification.uncertainty import ModelUncertainty, estimate_uncertainty
from amb_core.identification.validation import Validation, validate
from amb_core.identification.validation.overlap import fingerprint_of
from amb_core.loop.known_controller import KnownController
from amb_core.model import StateSpaceModel
from amb_core.robustness.certificate import Certificate, certify
from amb_core.robustness.feedback import Feedback, feedback_of, is_same_law
from amb_core.robustness.measured import MeasuredSensitivity, measured_sensitivity
from amb_core.robustness.settings import RobustnessSettings
from amb_core.robustness.sharp_peaks import SharpMode
from amb_core.robustness.sweep import modes_of, sweep_remarks


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
    feedback = require_fitting(model, law, settings or RobustnessSettings())
    if not feedback.stable:
        return certify(model, law, settings=settings, inputs=inputs)
    if swept is not None:
        _require_same(swept, law)
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
        measured = replace(_measured(swept, law, modes_of(swept.data, law)), checked=True)
        remarks += sweep_remarks(swept.data, feedback, law)
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


def require_fitting(model: StateSpaceModel, law: KnownController, settings: RobustnessSettings) -> Feedback:
    """The loop to certify, before anything long is done.

    Raises
    ------
    IdentificationError, ParameterError, RobustnessError
        If model and controller do not fit together: axes, their order, sample rate, units.
    """
    for what, units, wanted in (("inputs", model.input_units, "A"), ("outputs", model.output_units, "m")):
        if set(units) - {wanted, ""}:
            raise RobustnessError(
                f"the model has {what} in {', '.join(units)}; the currents of a bearing are in A and its positions in "
                "m: identify it from data with these units"
            )
    return feedback_of(model, law, settings.extra_delay)


def _measured(loop: Recorded, law: KnownController, modes: Sequence[SharpMode] = ()) -> MeasuredSensitivity:
    """Measured sensitivity of the loop to certify; RobustnessError if it was another loop."""
    _require_same(loop, law)
    assert loop.controller is not None
    return measured_sensitivity(loop.data, loop.controller, modes)


def _require_same(loop: Recorded, law: KnownController) -> None:
    """Raise RobustnessError if a recorded loop is another one than that of a controller."""
    if loop.controller is None:
        raise RobustnessError("the controller of the experiment is not known")
    if not is_same_law(loop.controller.at_rate(loop.data.sample_rate), law, len(loop.data.output_names)):
        raise RobustnessError("the experiment had another controller than the one to certify")


def _displacement(loop: Recorded) -> dict[str, float]:
    """Largest displacement over clearance, where the parameters of the plant are known."""
    if loop.plant is None:
        return {}
    clearance = loop.plant.rotor.backup_bearing_radius
    largest = np.max([np.abs(item.outputs).max(axis=0) for item in loop.data.experiments], axis=0)
    return {name: float(value / clearance) for name, value in zip(loop.data.output_names, largest, strict=True)}
