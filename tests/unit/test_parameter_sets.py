"""Parameter sets made by their class: wrong values are one line of our own error, as of `validate`."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from pydantic import ValidationError

from amb_core.excitation import Multisine
from amb_core.ground.errors import ParameterError
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.robustness import RobustnessSettings


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PlantParameters(rotor={"mass": -1}), "parameter 'rotor.mass' = -1 is not allowed; allowed: 0.001 to"),
        (lambda: PlantParameters(rotor={"mas": 1}), "unknown parameter 'rotor.mas' = 1; did you mean 'rotor.mass'?"),
        (lambda: PlantParameters(rotor=3), "parameter set 'rotor': int is not allowed; allowed: RotorParameters"),
        (lambda: ControllerParameters(proportional_gain="a"), "parameter 'proportional_gain' = 'a' is not allowed"),
        (lambda: ControllerParameters(proportional_gain=True), "parameter 'proportional_gain' = True is not allowed"),
        (
            lambda: ControllerParameters(derivative_on="x"),
            "parameter 'derivative_on' = 'x' is not allowed; allowed: one",
        ),
        (lambda: RobustnessSettings(actuater=0.1), "unknown parameter 'actuater' = 0.1; did you mean 'actuator'?"),
        (lambda: Multisine(amplitude=1e-5), "parameter 'duration' is missing; allowed: 0.001 to 600 s"),
        (lambda: Multisine(amplitude=1e-5, duration=1, frequency_start=500), "multisine: the band 500 Hz to 400 Hz is"),
    ],
)
def test_a_parameter_set_is_refused_as_by_validate(make: Callable[[], object], message: str) -> None:
    """The first wrong parameter as one line; the error of pydantic is its cause, and ValueError catches it."""
    with pytest.raises(ParameterError) as caught:
        make()
    assert str(caught.value).startswith(message) and "\n" not in str(caught.value)
    assert isinstance(caught.value, ValueError) and isinstance(caught.value.__cause__, ValidationError)
