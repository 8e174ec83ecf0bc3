"""Verdicts on excitations follow from the check and from the trial: another outcome, another verdict."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from amb_core.designs.excitation import ExcitationCheck, Trial, check_excitation
from amb_core.excitation import WhiteNoise, generate
from amb_core.loop.control import ControllerParameters
from amb_core.loop.records import LoopRecord
from amb_core.plant import PlantParameters
from amb_core.regions import Onset, Region
from amb_core.regions.region_map import Boundary, MapSettings, MapSweep, RegionMap
from amb_paper.studies.excitations_on_the_map import (
    judge_noise,
    judge_noise_content,
    judge_pulse_content,
    judge_pulses,
)


@pytest.fixture(scope="module")
def check() -> ExcitationCheck:
    """White noise on a map of two sweeps."""
    sweeps = tuple(
        MapSweep(amplitude, {Region.B: Boundary(8e-3 / amplitude, False)}, (), 5000.0, 1000)
        for amplitude in (5e-6, 100e-6)
    )
    noise = generate(WhiteNoise(amplitude=5e-6, frequency_end=4000.0, duration=0.5, axes="y"), 10_000.0)
    return check_excitation(noise, RegionMap(MapSettings(), sweeps), ControllerParameters(), PlantParameters())


def shares(a: float, b: float, c: float, d: float) -> dict[Region, float]:
    return dict(zip(Region, (a, b, c, d), strict=True))


def trial(region: Region) -> Trial:
    record = LoopRecord(0, 1e-4, np.zeros((10, 2)), np.zeros((10, 2)), np.zeros((10, 2)))
    return Trial(region, region, {region: Onset(5, 5e-4, 0.0, False)}, np.array([0.0, -20e-6]), record)


@pytest.mark.parametrize(
    ("content", "verdict"),
    [
        ((0.5, 0.3, 0.2, 0.0), "agrees"),
        ((0.6, 0.4, 0.0, 0.0), "agrees in part"),
        ((1.0, 0.0, 0.0, 0.0), "does not agree"),
    ],
)
def test_noise_must_reach_into_both_b_and_c(
    check: ExcitationCheck, content: tuple[float, float, float, float], verdict: str
) -> None:
    assert judge_noise_content(replace(check, shares=shares(*content))).verdict == verdict


@pytest.mark.parametrize(
    ("predicted", "simulated", "verdict"),
    [
        (Region.B, Region.B, "agrees"),
        (Region.A, Region.D, "agrees in part"),
        (Region.B, Region.A, "does not agree"),
    ],
)
def test_noise_is_nonlinear_only_if_the_simulation_shows_it(
    check: ExcitationCheck, predicted: Region, simulated: Region, verdict: str
) -> None:
    claim = judge_noise(replace(check, predicted=predicted), trial(simulated), trial(Region.A))
    assert claim.verdict == verdict
    assert bool(claim.reason) == (verdict != "agrees")


@pytest.mark.parametrize(("linear", "verdict"), [(1.0, "agrees"), (0.95, "agrees in part"), (0.5, "does not agree")])
def test_pulses_must_lie_in_a(check: ExcitationCheck, linear: float, verdict: str) -> None:
    claim = judge_pulse_content(replace(check, shares=shares(linear, 1.0 - linear, 0.0, 0.0)))
    assert claim.verdict == verdict
    assert bool(claim.reason) == (verdict != "agrees")


@pytest.mark.parametrize(
    ("predicted", "simulated", "verdict"),
    [
        (Region.A, Region.A, "agrees"),
        (Region.B, Region.A, "agrees in part"),
        (Region.A, Region.B, "does not agree"),
    ],
)
def test_pulses_must_leave_the_simulated_bearing_linear(
    check: ExcitationCheck, predicted: Region, simulated: Region, verdict: str
) -> None:
    claim = judge_pulses(replace(check, predicted=predicted), trial(simulated), trial(Region.D))
    assert claim.verdict == verdict
    assert bool(claim.reason) == (verdict != "agrees")
