"""Modes of an identified model in the loop of its controller, to compare with those of the computed loop."""

from __future__ import annotations

from amb_core.identification.closed_loop import loop_axes
from amb_core.linear.model.modes import Modes, modes_of
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.loop.known_controller import KnownController
from amb_core.plant.linearise import close_loop


def closed_loop_modes(model: StateSpaceModel, controller: KnownController) -> Modes:
    """Modes of the loop of an identified model and the controller without its limit.

    Parameters
    ----------
    model : StateSpaceModel
        Without direct feedthrough, as many inputs as outputs. `modes_of(model)` gives those without loop.
    controller : KnownController
        Of the experiment, or any other with its sample rate.

    Raises
    ------
    IdentificationError, ParameterError
        If model and controller do not fit together.
    """
    controller.require_axes(loop_axes(model, controller))
    return modes_of(close_loop(model, controller)[0])
