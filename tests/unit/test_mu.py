"""Bounds of mu where they were far apart: hidden modes; and blocks that are more than a number each."""

from __future__ import annotations

from dataclasses import replace

import ctrlsys
import numpy as np
import pytest
from scipy.linalg import block_diag

from amb_core.ground.errors import RobustnessError
from amb_core.linear import LinearSystem
from amb_core.linear.model import StateSpaceModel
from amb_core.loop.known_controller import LinearControl
from amb_core.loop.linear_control import LinearControllerParameters
from amb_core.robustness import Block, RobustnessSettings, feedback_of, mu_peak
from amb_core.robustness.mu_blocks import Blocks, lower_of_blocks, upper_of_blocks
from amb_core.robustness.replay import distance_from_circle
from amb_core.robustness.structure import bending_modes, uncertain_loop
from tests.lqg_loop import rotor

SMALL = RobustnessSettings(actuator=0.005, sensor=0.005, current_gain=0.005, negative_stiffness=0.01)
STEP = 1e-4
_HALF = np.array([
    [-1 + 6j, 2 - 3j, 3 + 8j, 3 + 8j, -5 - 9j, -6 + 2j],
    [4 + 2j, -2 + 5j, -6 - 7j, -4 + 11j, 8 - 7j, 12 - 1j],
    [5 - 4j, -4 - 8j, 1 - 3j, -6 + 14j, 2 - 5j, 4 + 16j],
])  # fmt: skip
SLICOT = np.vstack([_HALF, _HALF])
"""The example of the documentation of AB13MD: two real numbers, a full complex block of size 2, two complex numbers."""


def with_mode(model: StateSpaceModel, hertz: float, seen: float, driven: float = 0.1) -> StateSpaceModel:
    """A model with a bending mode of damping 0.005 more, that the positions show hardly or not at all."""
    (n, m), p, random = model.b.shape, model.outputs, np.random.default_rng(2)
    angle = 2.0 * np.pi * hertz * STEP
    turned = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return replace(
        model,
        a=block_diag(model.a, np.exp(-0.005 * angle) * turned),
        b=np.vstack([model.b, driven * random.normal(size=(2, m))]),
        c=np.hstack([model.c, seen * random.normal(size=(p, 2))]),
        k=np.vstack([model.k, np.zeros((2, p))]),
        initial_state=np.zeros(n + 2),
    )


@pytest.fixture(scope="module", params=[2, 4])
def loop(request):
    plant = rotor(request.param)
    return plant.model, LinearControl(plant.lqg(), LinearControllerParameters())


@pytest.mark.parametrize("seen", [1e-9, 3e-8])
def test_the_bounds_of_a_nearly_hidden_mode_meet(loop, seen: float) -> None:
    model, control = loop
    uncertain = uncertain_loop(feedback_of(with_mode(model, 1_258.0, seen), control), SMALL)
    peak = mu_peak(uncertain.system, uncertain.blocks, np.geomspace(1.0, 4_999.0, 150))
    assert peak.gap < 0.1
    assert distance_from_circle(uncertain.system, peak.perturbation, peak.lower_frequency) < 1e-6


@pytest.mark.parametrize(("seen", "driven"), [(0.0, 0.1), (1.0, 0.0)])
def test_a_mode_outside_a_minimal_realisation_is_not_perturbed(loop, seen: float, driven: float) -> None:
    model, control = loop
    wider = with_mode(model, 1_258.0, seen, driven)
    assert len(bending_modes(wider)) == len(bending_modes(model))
    peaks = []
    for one in (model, wider):
        uncertain = uncertain_loop(feedback_of(one, control), SMALL)
        peaks.append(mu_peak(uncertain.system, uncertain.blocks, np.geomspace(1.0, 4_999.0, 60)).upper)
    assert peaks[1] == pytest.approx(peaks[0], rel=1e-3)


def test_the_example_of_the_library_has_its_published_bound_and_a_perturbation_that_reaches_it() -> None:
    blocks = Blocks((1, 1, 2, 1, 1), (True, True, False, False, False))
    upper = upper_of_blocks(SLICOT, blocks)
    assert upper[0] == pytest.approx(41.74753408, rel=1e-7)
    theirs = ctrlsys.ab13md(
        np.asfortranarray(SLICOT), np.array(blocks.sizes, dtype=np.int32), np.array([1, 1, 2, 2, 2], dtype=np.int32)
    )[0]
    assert upper[0] == pytest.approx(theirs, rel=1e-7)
    lower, delta = lower_of_blocks(SLICOT, blocks, upper)
    assert lower == pytest.approx(upper[0], rel=1e-4)
    assert np.linalg.norm(delta, 2) == pytest.approx(1.0 / lower)
    assert np.abs(np.linalg.det(np.eye(6) - SLICOT @ delta)) < 1e-9


@pytest.mark.parametrize("seed", range(3))
def test_bounds_of_repeated_and_full_blocks_meet_nearly(seed: int) -> None:
    random, blocks = np.random.default_rng(seed), Blocks((3, 2, 1, 1), (True, False, True, False))
    matrix = random.normal(size=(7, 7)) + 1j * random.normal(size=(7, 7))
    upper = upper_of_blocks(matrix, blocks)
    lower, delta = lower_of_blocks(matrix, blocks, upper)
    assert 0.97 * upper[0] < lower <= upper[0] * (1.0 + 1e-9)
    assert np.abs(np.linalg.det(np.eye(7) - matrix @ delta)) < 1e-8
    assert delta[:3, :3] == pytest.approx(delta[0, 0].real * np.eye(3))


def test_one_full_block_has_the_largest_gain_as_its_mu() -> None:
    random = np.random.default_rng(0)
    a, b, c = 0.9 * np.eye(2), random.normal(size=(2, 3)), random.normal(size=(3, 2))
    system = LinearSystem(a, b, c, np.zeros((3, 3)), STEP)
    grid = np.geomspace(10.0, 4_000.0, 12)
    peak = mu_peak(system, [Block("all", size=3)], grid)
    assert peak.upper == pytest.approx(system.gain(0.0), rel=1e-6)
    assert peak.gap < 1e-6
    with pytest.raises(RobustnessError, match="perturbations of 2 rows"):
        mu_peak(system, [Block("two", size=2)], grid)
