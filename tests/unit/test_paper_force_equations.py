"""The paper's eq. (1) to (4): identities hold for any signals, and verdicts turn when they do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from amb_core.plant import MagneticCircuitParameters, Plant, PlantParameters
from amb_core.plant.closed_forms import force_constant
from amb_core.plant.force_law import ForceTrajectory, electromagnet_force, iron_path_length
from amb_core.regions import Region
from amb_core.report.figures.drawing import Points
from amb_core.report.figures.force import force_chart, force_speed_chart
from amb_paper.studies.force_equations import (
    ForceEquations,
    derivative_claim,
    inference_claim,
    rearrangement_claim,
    unrelated_signals,
)

K = force_constant(MagneticCircuitParameters())


@pytest.fixture(scope="module")
def random() -> ForceTrajectory:
    return unrelated_signals(K)


def test_the_rearranged_equation_holds_for_signals_at_random(random: ForceTrajectory) -> None:
    moving = random.moving
    assert_allclose(random.force_by_rates[moving], random.force[moving], rtol=1e-6)
    assert np.isnan(random.force_by_rates[~moving]).all()


def test_the_rate_of_the_force_is_the_derivative_of_its_law(random: ForceTrajectory) -> None:
    assert_allclose(random.rate_by_law, random.force_rate, atol=1e-6 * np.abs(random.force_rate).max())


def test_the_exponent_of_the_speed_is_found() -> None:
    time = np.linspace(0.0, 1.0, 1_001)
    gap = 0.5e-3 + 0.1e-3 * time**2  # its speed rises with time
    falling = ForceTrajectory.of(time, np.ones_like(time), gap, 1.0 / (time + 5e-4), K)
    assert falling.speed_exponent == pytest.approx(-1.0, abs=0.02)
    assert inference_claim({Region.B: falling}).verdict == "agrees"


def test_force_that_speed_does_not_decide_contradicts_the_inference(random: ForceTrajectory) -> None:
    claim = inference_claim({Region.A: random})
    assert claim.verdict == "does not agree"
    assert claim.reason


def test_a_wrong_force_is_noticed(random: ForceTrajectory) -> None:
    wrong = replace(random, force=1.01 * random.force)
    assert rearrangement_claim({Region.A: random}, random).verdict == "agrees"
    assert rearrangement_claim({Region.A: wrong}, random).verdict == "does not agree"
    assert rearrangement_claim({Region.A: random}, wrong).verdict == "does not agree"
    assert derivative_claim({Region.A: random}).verdict == "agrees"
    assert derivative_claim({Region.A: replace(random, constant=1.01 * K)}).verdict == "does not agree"


def test_the_force_law_with_iron_is_that_of_the_magnetic_circuit() -> None:
    """The force of one electromagnet alone in its circuit, the rotor centred."""
    circuit = MagneticCircuitParameters(coupling=False, actuators="top_coil")
    plant = Plant(PlantParameters(magnetic_circuit=circuit))
    flux = plant.static_flux(np.array([0.0, 3.0, 0.0, 0.0]), 0.0, 0.0)
    expected = electromagnet_force(circuit, iron_path_length(plant), np.array(3.0), np.array(circuit.air_gap))
    assert_allclose(plant.magnetostatics.force(flux)[1], expected, rtol=1e-12)


def test_figures_show_every_trajectory(random: ForceTrajectory) -> None:
    trajectories = {Region.A: random, Region.C: random}
    assert [panel.title for panel in force_chart(trajectories).panels] == ["A steady bias", "C slow oscillation"]
    (panel,) = force_speed_chart(trajectories).panels
    points = [item for item in panel.items if isinstance(item, Points)]
    assert len(points) == 2
    assert all(len(item.x) < 600 for item in points)


@pytest.mark.slow
def test_the_identities_hold_in_every_region_of_a_sweep() -> None:
    verdicts = {claim.id: claim.verdict for claim in ForceEquations().run().claims}
    assert verdicts["eq-1"] == verdicts["eq-3"] == verdicts["eq-4"] == "agrees"
    assert verdicts["eq-4-inference"] == "does not agree"
