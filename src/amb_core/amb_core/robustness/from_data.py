"""A certificate from recorded data: the uncertainty of the model, its validation, what was measured, and the verdict.

`amb certify`, the service `identifier/certify` and `amb report --certify` all come here, so they give one answer.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from amb_core.data.experiments import IdentificationData
from amb_core.data.experiments import RecordedLoop as Recorded
from amb_core.data.experiments.checks import Severity
from amb_core.data.experiments.drift import cure_drift
from amb_core.data.experiments.tones import without_unanswered
from amb_core.ground.errors import AmbError, RobustnessError
from amb_core.ground.given_values import require_kind
from amb_core.ground.parameters import given_set
from amb_core.ground.sample_times import same_sample_time
from amb_core.identification.controller_check import check_controller
from amb_core.identification.given import (
    Controller,
    Data,
    Model,
    given_controller,
    given_loop,
    given_model,
    is_identified,
)
from amb_core.identification.uncertainty import ModelUncertainty, uncertainty_of
from amb_core.identification.validation import Validation, validate
from amb_core.identification.validation.noise_model import with_noise_model
from amb_core.identification.validation.overlap import fingerprint_of
from amb_core.linear.model import StateSpaceModel
from amb_core.loop.known_controller import KnownController
from amb_core.robustness.certificate import Certificate, certify
from amb_core.robustness.checks import NOT_RUN
from amb_core.robustness.displacement import largest_displacements
from amb_core.robustness.feedback import Feedback, feedback_of, is_same_law
from amb_core.robustness.given_results import require_of_model, require_results
from amb_core.robustness.measured import MeasuredSensitivity, measured_sensitivity
from amb_core.robustness.settings import RobustnessSettings
from amb_core.robustness.sweep import modes_of, sweep_remarks


def certify_from_data(
    model: Model,
    controller: Controller | None = None,
    data: Data | None = None,
    validation_data: Data | None = None,
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
    model : StateSpaceModel, Identification, LinearSystem or control.StateSpace
        The identified model, the result of its identification, or a plant of one's own from currents to positions.
    controller : KnownController, LinearSystem, control.StateSpace or str, optional
        The controller to certify, or its name; it may differ from that of the experiments. By default that of the data.
    data : LoopRecord, IdentificationData or RecordedLoop, optional
        What the model was identified from, for its uncertainty; by default that of an Identification. Without it
        nothing is certified. Only a RecordedLoop, which `amb_core.read` returns, knows its controller; the others are
        taken as of a loop with `controller`, which the validation checks.
    validation_data : LoopRecord, IdentificationData or RecordedLoop, optional
        What the model is validated on; by default `data`.
    settings : RobustnessSettings, optional
        What is assumed and demanded. The defaults if None.
    inputs : mapping, optional
        Name and SHA-256 of everything that was read. None for nothing.
    validation, uncertainty : Validation, ModelUncertainty, optional
        Of this model, where they are known already; otherwise they are computed from the data.
    swept : Recorded, optional
        A swept sine on the running loop: its measured peak is checked too. By default the measured sensitivity is taken
        from the data of the validation, and shown only.
    progress : callable, optional
        Called with the name of each stage.

    Returns
    -------
    Certificate
        The result, with the reason where nothing is certified.

    Raises
    ------
    AmbError
        If model, controller and data do not fit together.
    RobustnessError
        If the controller of the swept sine is not known, or is another one, or validation or uncertainty are of another
        model.
    """
    settings = given_set(RobustnessSettings, "settings", settings)
    require_results(validation, uncertainty)
    none = type(None)
    require_kind("inputs", inputs, (Mapping, none), "SHA-256 by name, or None", RobustnessError)
    require_kind("swept", swept, (Recorded, none), "what amb_core.read returns, or None", RobustnessError)
    model, law, identified_from, judged_on, uncertainty = _given(model, controller, data, validation_data, uncertainty)
    require_of_model(model, validation, uncertainty)
    feedback = require_fitting(model, law, settings)
    if not feedback.stable:
        return certify(model, law, settings=settings, inputs=inputs)
    plain = model
    if (any_loop := identified_from or judged_on) is not None:
        model = with_noise_model(model, any_loop.data)
    if swept is not None and swept.controller is None:
        raise RobustnessError("the controller of the swept sine is not known")
    judged = judged_on or identified_from
    if uncertainty is None and identified_from is not None:
        progress("uncertainty of the model")
        calm = without_unanswered(identified_from.data)  # as `identify` does
        cure = cure_drift(calm)
        uncertainty = uncertainty_of(model, calm if cure is None else cure.data)
    if judged is not None and validation is None:
        progress("validating")
        known = plain
        if identified_from is not None and not len(plain.fingerprint) and np.any(plain.k):  # of an old file
            noise = np.sqrt(np.diag(model.innovation_covariance))
            known = replace(model, fingerprint=fingerprint_of(identified_from.data, noise))
        validation = validate(known, judged.data, judged.controller, uncertainty=uncertainty)
    loops = [loop for loop in (judged, identified_from, swept) if loop is not None]
    displacement = largest_displacements(loops)
    if swept is not None:
        progress("swept sine")
    others = (judged, identified_from)
    measured, not_measured, remarks = _measured_by(swept, others, feedback, law, settings.extra_delay)
    if loops and not displacement:
        remarks += ("the zone after ISO 14839-2 is not known: the data come without the parameters of the bearing",)
    progress("margins, worst cases and bounds")
    certificate = certify(
        model, law, settings=settings, validation=validation, uncertainty=uncertainty, inputs=inputs,
        measured=measured, displacement=displacement,
        records=() if identified_from is None or judged is identified_from else (identified_from.data,),
        not_measured=not_measured,
    )  # fmt: skip
    if uncertainty is not None and uncertainty.widened:
        remarks += (uncertainty.widened,)
    return replace(certificate, warnings=(*certificate.warnings, *remarks))


def _given(
    model: Model,
    controller: Controller | None,
    data: Data | None,
    validation_data: Data | None,
    uncertainty: ModelUncertainty | None,
) -> tuple[StateSpaceModel, KnownController, Recorded | None, Recorded | None, ModelUncertainty | None]:
    """Model, controller to certify, data with their controllers, and uncertainty."""
    used, judged = (None if item is None else given_loop(item) for item in (data, validation_data))
    any_loop = used or judged
    plain = given_model(model, None if any_loop is None else any_loop.data)
    if is_identified(model):
        used = used or Recorded(model.data, model.controller)
        uncertainty = uncertainty or model.uncertainty
    recorded = next((one.controller for one in (judged, used) if one is not None and one.controller is not None), None)
    law = given_controller(controller, plain.sample_time)
    law = law or (None if recorded is None else recorded.at_rate(1.0 / plain.sample_time))
    if law is None:
        raise RobustnessError("no controller is given, and the data know none; give the controller to certify")
    if not isinstance(data, Recorded) and used is not None:
        used = replace(used, controller=used.controller or _limited(controller, used.data) or law)
    if not isinstance(validation_data, Recorded) and judged is not None:
        judged = replace(judged, controller=_limited(controller, judged.data) or law)
    return plain, law, used, judged, uncertainty


def _limited(controller: Controller | None, data: IdentificationData) -> KnownController | None:
    """The given controller with the limit that data of its loop show."""
    return given_controller(controller, data.sample_time, data)


def require_fitting(model: StateSpaceModel, law: KnownController, settings: RobustnessSettings) -> Feedback:
    """The loop to certify, before anything long is done.

    Raises
    ------
    IdentificationError, ParameterError, RobustnessError
        If model and controller do not fit together: axes, their order, sample rate, units.
    """
    for what, units, wanted in (("inputs", model.input_units, "A"), ("outputs", model.output_units, "m")):
        if "" in units:
            raise RobustnessError(
                f"the units of the model's {what} are not known; the currents of a bearing are in A and its positions "
                "in m: identify it from data with units, which --units A,um gives, for example, or a heading such as "
                "x [um]"
            )
        if set(units) - {wanted}:
            raise RobustnessError(
                f"the model has {what} in {', '.join(units)}; the currents of a bearing are in A and its positions in "
                "m: identify it from data with these units"
            )
    return feedback_of(model, law, settings.extra_delay)


def _measured_by(
    swept: Recorded | None,
    others: Sequence[Recorded | None],
    feedback: Feedback,
    law: KnownController,
    extra_delay: float,
) -> tuple[MeasuredSensitivity | None, str, tuple[str, ...]]:
    """The sensitivity that a swept sine shows, else other data of this controller; why there is none; remarks."""
    remarks: tuple[str, ...] = ()
    if extra_delay:  # no data have it: it comes in addition to theirs
        if swept is not None:
            remarks = ("the swept sine is left out: it is of a loop without the extra delay",)
        return None, f"no data are of a loop with the extra delay of {extra_delay:g} steps", remarks
    why_not = NOT_RUN
    if swept is not None:
        foreign = _not_run_by(swept, law)
        if not foreign:
            measured = measured_sensitivity(swept.data, law, modes_of(swept.data, law))
            return replace(measured, checked=True), "", sweep_remarks(swept.data, feedback, law)
        cause = "it is not of a loop with this controller" if foreign == NOT_RUN else foreign
        remarks = (f"the swept sine is left out: {cause}",)
    for loop in others:
        if loop is None:
            continue
        foreign = _not_run_by(loop, law)
        if foreign:
            why_not = foreign
            continue
        try:
            return measured_sensitivity(loop.data, law), "", remarks
        except AmbError as problem:
            why_not = f"its sensitivity was not measured: {problem}"
    return None, why_not, remarks


def _not_run_by(loop: Recorded, law: KnownController) -> str:
    """Why data are not taken as of a loop with a controller; empty if they are.

    What is said of the data must fit, and what they show: the controller computes their currents.
    """
    rate = loop.data.sample_rate
    rate = law.sample_rate if same_sample_time(rate, law.sample_rate) else rate
    if loop.controller is None or not is_same_law(loop.controller.at_rate(rate), law, len(loop.data.output_names)):
        return NOT_RUN
    finding = check_controller(loop.data, law)
    return finding.text if finding.severity is Severity.WARNING else ""
