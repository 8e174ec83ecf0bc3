"""The loop without ROS: what it refuses before a sample is computed."""

from __future__ import annotations

import numpy as np
import pytest

from amb_core.ground.errors import ExcitationError, ParameterError
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant
from amb_core.plant.simulation import simulate


def run(steps: int = 20, excitation: np.ndarray | None = None, first: int = 0) -> LoopRecord:
    return simulate(Plant(), PdController(ControllerParameters()), steps, excitation, first)


@pytest.mark.parametrize("shape", [(5,), (5, 1), (2, 5), (5, 3)])
def test_an_excitation_has_a_column_for_each_axis(shape: tuple[int, ...]) -> None:
    with pytest.raises(
        ExcitationError, match=r"the excitation has shape .*; allowed: \(n, 2\), axes x, y, zeros on an axis at rest"
    ):
        run(excitation=np.zeros(shape))


def test_an_excitation_is_finite() -> None:
    samples = np.zeros((5, 2))
    samples[3, 1] = np.nan
    with pytest.raises(ExcitationError, match="the excitation on y is nan at its sample 3"):
        run(excitation=samples)


@pytest.mark.parametrize("first", [-1, 21])
def test_an_excitation_begins_within_the_run(first: int) -> None:
    with pytest.raises(ExcitationError, match=rf"excitation_step = {first} is outside the run of 20 steps; allowed: 0"):
        run(excitation=np.zeros((5, 2)), first=first)


def test_an_excitation_may_last_longer_than_the_run() -> None:
    reference = run(excitation=np.full((5, 2), 1e-6), first=17).reference
    np.testing.assert_array_equal(reference[:, 0], np.where(np.arange(20) < 17, 0.0, 1e-6))


def test_negative_steps_are_refused() -> None:
    with pytest.raises(ParameterError, match="steps = -3 is not allowed; allowed: 0 or more"):
        run(steps=-3)
