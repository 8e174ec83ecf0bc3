"""The services of the identifier as plain calls: identify, validate, certify."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import fields as fields_of
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from amb_bringup.client.connection import GraphConnection
from amb_bringup.client.errors import ClientError
from amb_bringup.client.request_fields import absolute, controller_name, description_text, with_settings
from amb_core.linear.model import StateSpaceModel
from amb_core.recording.messages.state_space_model import model_from_message
from amb_msgs.action import Identify
from amb_msgs.srv import Certify, GetModel, Validate
from amb_ros.requests import COMPUTED, QUICKLY

if TYPE_CHECKING:
    from amb_core.data.experiments import DataDescription
    from amb_core.identification import IdentificationProgress


class IdentifiedModel(StateSpaceModel):
    """A model, and the verdict on it.

    Attributes
    ----------
    verdict : str
        A constant of `amb_msgs/action/Identify`; a copy with other matrices is NOT_VALIDATED.
    """

    verdict: str = Identify.Result.NOT_VALIDATED

    @classmethod
    def of(cls, model: StateSpaceModel, verdict: str) -> IdentifiedModel:
        """A model with a verdict."""
        copied = cls(**{item.name: getattr(model, item.name) for item in fields_of(model)})
        object.__setattr__(copied, "verdict", verdict)
        return copied


class IdentifierCalls(GraphConnection):
    """Calls the node identifier."""

    def identify(
        self,
        bag: str | Path = "",
        order: int | Literal["auto"] = 0,
        method: str = "",
        focus: str = "",
        first_step: int = -1,
        steps: int = 0,
        progress: Callable[[IdentificationProgress], None] | None = None,
        cancelled: Callable[[], bool] | None = None,
        controller: str | Path = "",
        description: DataDescription | str | Path = "",
    ) -> IdentifiedModel:
        """Identify from the last experiment or from a bag, without a time limit.

        Parameters
        ----------
        bag : str or Path, optional
            Bag or data file, as `amb identify` takes; by default the telemetry of the current run.
        order : int or "auto", optional
            Number of states, or "auto" to choose it from the data; 0 for the identifier's default.
        method, focus : str, optional
            As in `amb_core.identification.identify`; empty for the identifier's default, and for prediction.
        first_step, steps : int, optional
            Steps used; by default those of the last excitation.
        progress : callable, optional
            Called with an `IdentificationProgress` at every stage and iteration. None for no calls.
        cancelled : callable, optional
            Called while waiting; when it returns true the identification is cancelled, which raises an error. None if
            it cannot be cancelled.
        controller : str or Path, optional
            Controller of the experiment: `paper`, `pd:K_P,K_D`, a ROS parameter file (.yaml), the file of a linear
            controller, `none`, or the name of a running node; by default the running one, or the one recorded in the
            bag. An error if that is not known.
        description : DataDescription or str or Path, optional
            How to read a data file or bag of others: a description, its text, or the file of a saved one (.yaml).

        Returns
        -------
        IdentifiedModel
            The model, with the verdict on it: look at `verdict`, or `validate` on other data, before you use it.

        Raises
        ------
        ClientError
            If the identifier is missing, refuses, or finds no model.
        """

        def on_feedback(message: Any) -> None:
            feedback = message.feedback
            if progress is not None:
                from amb_core.identification import IdentificationProgress  # takes half a second to import

                cost = None if math.isnan(feedback.cost) else feedback.cost
                progress(IdentificationProgress(feedback.stage, feedback.done, feedback.total, cost))

        auto = isinstance(order, str) and order == "auto"
        result = self.act(
            Identify,
            "identifier/identify",
            on_feedback=on_feedback,
            cancelled=cancelled or (lambda: False),
            bag=absolute(bag),
            order=0 if auto else order,
            auto_order=auto,
            method=method,
            focus=focus,
            first_step=first_step,
            steps=steps,
            controller=controller_name(controller),
            description=description_text(description),
        )
        if not result.success:
            raise ClientError(result.message)
        return IdentifiedModel.of(model_from_message(result.model), result.verdict)

    def validate(
        self,
        bag: str | Path = "",
        model: str | Path = "",
        first_step: int = -1,
        steps: int = 0,
        timeout: float = 300.0,
        controller: str | Path = "",
        description: DataDescription | str | Path = "",
    ) -> Validate.Response:
        """Validate a model on the last experiment or a bag, ideally with data that it was not identified from.

        Parameters
        ----------
        bag : str or Path, optional
            Bag or data file, as `amb identify` takes; by default the telemetry of the current run.
        model : str or Path, optional
            File of the model; by default the last identified one.
        first_step, steps : int, optional
            Steps used; by default those of the last excitation.
        timeout : float, optional
            Longest wait (s).
        controller : str or Path, optional
            Controller of the experiment, as for `identify`.
        description : DataDescription or str or Path, optional
            How to read a data file or bag of others, as for `identify`.

        Returns
        -------
        Validate.Response
            Its fields are described in `amb_msgs/srv/Validate`.
        """
        return self.call(
            Validate,
            "identifier/validate",
            timeout=timeout,
            repeat_after=COMPUTED,
            bag=absolute(bag),
            model=absolute(model),
            first_step=first_step,
            steps=steps,
            controller=controller_name(controller),
            description=description_text(description),
        )

    def certify(
        self,
        controller: str | Path = "",
        model: str | Path = "",
        bag: str | Path = "",
        validation_bag: str | Path = "",
        sweep_bag: str | Path = "",
        out: str | Path = "",
        timeout: float = 300.0,
        on_telemetry: bool = False,
        experiment_controller: str | Path = "",
        description: DataDescription | str | Path = "",
        **settings: Any,
    ) -> Certify.Response:
        """Certify the robustness of a model with a controller, as `amb certify` does.

        A loop that is not certified is no error: `certified` of the answer is false, and `reasons` names the checks
        that failed. `certified` is true with reservations on the model too; `statement` shows which.

        Parameters
        ----------
        controller : str or Path, optional
            Controller to certify: `paper`, `pd:K_P,K_D` (A/m, A s/m), a ROS parameter file (.yaml), the file of a
            linear controller (.json, .npz, .mat), or the name of a running node; by default that of the experiment.
        model : str or Path, optional
            File of the model; by default the last identified one.
        bag : str or Path, optional
            What the model was identified from; by default, for the last identified model, its data.
        validation_bag : str or Path, optional
            Another experiment for the validation; by default the data of the model.
        sweep_bag : str or Path, optional
            A swept sine on the running loop, as `measure_sensitivity` records it.
        out : str or Path, optional
            Folder for certificate.html and certificate.json.
        timeout : float, optional
            Longest wait (s).
        on_telemetry : bool, optional
            Validate on the last experiment of the current run.
        experiment_controller : str or Path, optional
            Controller of the experiments, as for `identify`.
        description : DataDescription or str or Path, optional
            How to read files of others, as for `identify`.
        **settings : object
            Further fields of `amb_msgs/srv/Certify`: sizes of the perturbations, confidence, limits of the zones;
            machine, serial_number, speed, load, author and validity for the page.

        Returns
        -------
        Certify.Response
            Its fields are described in `amb_msgs/srv/Certify`.
        """
        own = {
            "controller": controller_name(controller),
            "description": description_text(description),
            "model": absolute(model),
            "bag": absolute(bag),
            "validation_bag": absolute(validation_bag),
            "sweep_bag": absolute(sweep_bag),
            "out": absolute(out),
            "on_telemetry": on_telemetry,
            "experiment_controller": controller_name(experiment_controller),
        }
        fields = with_settings(Certify.Request, own, settings)
        return self.call(Certify, "identifier/certify", timeout=timeout, repeat_after=COMPUTED, **fields)

    def get_model(self) -> StateSpaceModel:
        """The last identified model.

        Returns
        -------
        StateSpaceModel
            The model.
        """
        return model_from_message(self.call(GetModel, "identifier/get_model", repeat_after=QUICKLY).model)
