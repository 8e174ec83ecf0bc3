"""A controller as data of its loop describe it: parameters of the PD law, or any linear law with its limit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from amb_core.ground.errors import AmbError, ParameterError
from amb_core.ground.given_values import require_kind
from amb_core.ground.parameters import choice
from amb_core.ground.sample_times import same_sample_time
from amb_core.linear import LinearSystem
from amb_core.linear.model import StateSpaceModel
from amb_core.loop.controller_files import controller_from, load_controller
from amb_core.loop.linear_parameters import LinearControllerParameters, require_fit, with_anti_windup
from amb_core.loop.pd_parameters import ControllerParameters
from amb_core.loop.records import sample_rate_of

if TYPE_CHECKING:
    import control

UNLIMITED = 100.0
"""Limit of the currents of a law whose limit is not known (A): the largest that is allowed."""
_MATRICES = ("a", "b", "c", "d", "k", "input_offset", "output_offset")


class ControllerFileParameters(LinearControllerParameters):
    """Parameters of a linear controller that comes from a file or from a topic."""

    controller_file: str = choice(
        "",
        "file of the controller: A, B, C, D and Ts, or as StateSpaceModel.save writes one; empty: the topic controller",
    )


@dataclass(frozen=True, eq=False)
class LinearControl:
    """A linear control law, and the limit of its currents. Two are equal if they compute the same currents.

    Attributes
    ----------
    model : StateSpaceModel
        The law, as `LinearController` takes it; with an anti-windup gain where it needs one.
    parameters : LinearControllerParameters
        Limit and nominal reference.

    Raises
    ------
    ParameterError
        If the law needs an anti-windup gain and none is found.
    """

    model: StateSpaceModel
    parameters: LinearControllerParameters

    def __post_init__(self) -> None:
        require_kind("model", self.model, StateSpaceModel, "a StateSpaceModel", ParameterError)
        require_kind(
            "parameters", self.parameters, LinearControllerParameters, "LinearControllerParameters", ParameterError
        )
        object.__setattr__(self, "model", with_anti_windup(self.model))

    @classmethod
    def load(cls, path: str | Path, parameters: LinearControllerParameters | None = None) -> LinearControl:
        """From a file, see `load_controller`; by default without limit.

        Raises
        ------
        ParameterError
            If the file cannot be read or does not hold a controller.
        """
        try:
            return cls(load_controller(path), _without_limit() if parameters is None else parameters)
        except AmbError as problem:
            raise ParameterError(f"controller {problem}") from None

    @classmethod
    def of(
        cls, system: LinearSystem | control.StateSpace, parameters: LinearControllerParameters | None = None
    ) -> LinearControl:
        """From a controller that was designed in Python, see `controller_from`; by default without limit.

        Raises
        ------
        ParameterError
            If it is no linear system of discrete time.
        """
        return cls(controller_from(system), _without_limit() if parameters is None else parameters)

    @cached_property
    def sample_rate(self) -> float:
        """Sample rate (Hz)."""
        return sample_rate_of(self.model.sample_time)

    @property
    def current_limit(self) -> float:
        """Limit on the magnitude of the currents (A)."""
        return self.parameters.current_limit

    def at_rate(self, sample_rate: float) -> LinearControl:
        """The same controller, if it is made for the sample rate of a machine (Hz): a law cannot change its rate.

        Raises
        ------
        ParameterError
            If it is made for another.
        """
        if not same_sample_time(self.model.sample_time, 1.0 / sample_rate):
            raise ParameterError(
                f"the controller is made for {self.sample_rate:g} Hz, the data are sampled at {sample_rate:g} Hz; give "
                "the controller with which they were taken"
            )
        return self

    def require_axes(self, axes: int) -> None:
        """Raise ParameterError if it is made for another number of axes, or other signals."""
        require_fit(self.model, axes, 1.0 / self.model.sample_time)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, LinearControl):
            return NotImplemented
        return (
            self.model.sample_time == other.model.sample_time
            and self.current_limit == other.current_limit
            and all(np.array_equal(getattr(self.model, name), getattr(other.model, name)) for name in _MATRICES)
        )

    def __hash__(self) -> int:
        return hash((self.model.sample_time, self.current_limit, self.model.a.tobytes()))


KnownController = ControllerParameters | LinearControl
"""Either kind."""


def _without_limit() -> LinearControllerParameters:
    return LinearControllerParameters(current_limit=UNLIMITED)


def limited(controller: KnownController, current_limit: float | None) -> KnownController:
    """A controller with a limit (A), if there is one and its own is not known."""
    if current_limit is None or controller.current_limit < UNLIMITED:
        return controller
    if isinstance(controller, LinearControl):
        parameters = controller.parameters.model_copy(update={"current_limit": current_limit})
        return replace(controller, parameters=parameters)
    return controller.model_copy(update={"current_limit": current_limit})
