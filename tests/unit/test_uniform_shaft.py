"""A uniform shaft has the modes that textbooks give, and without bending it is the rigid rotor."""

from __future__ import annotations

import math

import numpy as np
import pytest

from amb_core.ground.errors import PlantError
from amb_core.plant import uniform_shaft
from amb_core.plant.parameters import PlantParameters, RigidRotorParameters, RotorParameters
from amb_core.plant.rotor import modal_rotor, rigid_rotor

LENGTH, DIAMETER, DENSITY, MODULUS = 0.5, 0.02, 7850.0, 2.1e11
MASS = DENSITY * math.pi * DIAMETER**2 / 4 * LENGTH


def test_first_bending_frequency_is_that_of_a_free_beam() -> None:
    data = uniform_shaft(LENGTH, DIAMETER, (-0.15, 0.15))
    inertia = math.pi * DIAMETER**4 / 64
    expected = 22.3733 / (2 * math.pi) * math.sqrt(MODULUS * inertia / (MASS * LENGTH**3))
    assert data.natural_frequencies[4] == pytest.approx(expected, rel=1e-5)
    ratios = data.natural_frequencies[4::2] / data.natural_frequencies[4]
    np.testing.assert_allclose(ratios, [1.0, 2.7565, 5.4039], rtol=1e-4)


def test_bearings_in_the_nodes_of_the_first_bending_do_not_feel_it() -> None:
    node = (0.5 - 0.22416) * LENGTH
    data = uniform_shaft(LENGTH, DIAMETER, (-node, node), bending_modes=1)
    np.testing.assert_allclose(data.bearings[:, 4:] * math.sqrt(MASS), 0.0, atol=1e-4)


def test_free_ends_move_twice_the_root_mean_square() -> None:
    data = uniform_shaft(LENGTH, DIAMETER, (-LENGTH / 2, LENGTH / 2), bending_modes=8)
    np.testing.assert_allclose(np.abs(data.bearings[0, 4::2]) * math.sqrt(MASS), 2.0, rtol=1e-5)


def test_without_bending_it_is_the_rigid_rotor() -> None:
    data = uniform_shaft(LENGTH, DIAMETER, (-0.1, 0.2), bending_modes=0)
    body = RigidRotorParameters(
        mass=MASS,
        transverse_inertia=MASS * LENGTH**2 / 12,
        polar_inertia=MASS * DIAMETER**2 / 8,
        bearing_a=-0.1,
        bearing_b=0.2,
        sensor_a=-0.1,
        sensor_b=0.2,
    )
    parameters = PlantParameters(rotor=RotorParameters(model="rigid", running_speed=100.0), rigid_rotor=body)
    shaft = modal_rotor(data, gravity=9.81, running_speed=100.0)
    np.testing.assert_allclose(
        shaft.natural_frequencies(1e5), rigid_rotor(parameters).natural_frequencies(1e5), rtol=1e-9
    )
    assert np.linalg.norm(shaft.weight) == pytest.approx(math.sqrt(MASS) * 9.81)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"diameter": 0.0}, "diameter = 0; it must be positive"),
        ({"bearings": (-0.3, 0.1)}, r"within 0.25 m of the middle"),
        ({"bearings": (0.1, -0.1)}, "A below B"),
        ({"bending_modes": 9}, "allowed: 0 to 8"),
    ],
)
def test_what_is_no_shaft_is_refused(change: dict[str, object], message: str) -> None:
    asked: dict[str, object] = {"length": LENGTH, "diameter": DIAMETER, "bearings": (-0.1, 0.1)} | change
    with pytest.raises(PlantError, match=message):
        uniform_shaft(**asked)  # type: ignore[arg-type]
