"""The backup bearing: rest, bounce, friction, and a rotor that comes back."""

import re

import numpy as np
import pytest

from amb_core.ground.errors import PlantError
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import AmplifierParameters, Plant, PlantParameters, RotorParameters
from amb_core.plant.internal_step import contact_limits
from amb_core.plant.parameters import BackupBearingParameters, RigidRotorParameters
from amb_core.plant.rotor import contact_mass, rotor_model
from tests.validation.energy import EnergyAccount

MASS, GRAVITY = 6.25, 9.81


def free_rotor(backup_bearing: BackupBearingParameters, **rotor: float) -> Plant:
    return Plant(
        PlantParameters(
            amplifier=AmplifierParameters(bias_current=0.0),
            rotor=RotorParameters(**rotor),
            backup_bearing=backup_bearing,
        )
    )


def test_rotor_rests_on_the_backup_bearing_at_its_weight_over_the_contact_stiffness():
    plant = free_rotor(BackupBearingParameters(contact=True), initial_y=-249e-6)
    for _ in range(1_500):
        plant.advance((0.0, 0.0))
    snapshot = plant.snapshot()
    assert not plant.delevitated
    assert snapshot.contact[0]
    assert -snapshot.position[0, 1] - 250e-6 == pytest.approx(MASS * GRAVITY / 2e7, rel=1e-2)
    assert snapshot.contact_force[0] == pytest.approx([0.0, MASS * GRAVITY], rel=1e-2, abs=0.1)


@pytest.mark.parametrize("damping", [0.0, 2e3])
def test_restitution_of_a_bounce_is_that_of_spring_and_damper_that_only_push(damping):
    """Schwager, Pöschel, "Coefficient of restitution and linear-dashpot model revisited", Granular Matter 9 (2007)."""
    stiffness, arrival = 2e7, 0.05
    plant = free_rotor(
        BackupBearingParameters(contact=True, stiffness=stiffness, damping=damping, friction=0.0),
        gravity=0.0,
        initial_y=-245e-6,
    )
    plant._arrays.bearings[0]["velocity"][1] = -arrival
    account = EnergyAccount(plant)
    for _ in range(30):
        trace = plant.trace((0.0, 0.0))
        account.add(trace)
    rate, natural = damping / (2.0 * MASS), np.sqrt(stiffness / MASS)
    ringing = np.sqrt(natural**2 - rate**2)
    restitution = np.exp(-rate / ringing * (np.pi - np.arctan2(2.0 * rate * ringing, ringing**2 - rate**2)))
    assert trace.velocity[-1, 1] / arrival == pytest.approx(restitution, rel=1e-3)
    assert account.contact == pytest.approx(0.5 * MASS * arrival**2 * (restitution**2 - 1.0), abs=1e-3 * 0.0078)
    assert abs(account.rotor_residual) < 1e-6


def rebound(backup_bearing: BackupBearingParameters, mass: float, arrival: float = 1.0) -> float:
    """Velocity of a point mass after its bounce over that before, without gravity."""
    plant = free_rotor(backup_bearing, gravity=0.0, mass=mass, initial_y=-249.9e-6)
    plant._arrays.bearings[0]["velocity"][1] = -arrival
    trace = plant.trace((0.0, 0.0))
    left = np.flatnonzero(trace.contact_force[:, 1])[-1] + 2  # a step has half a step of the force before it
    return trace.velocity[left, 1] / arrival


@pytest.mark.parametrize(
    ("values", "stated"),
    [
        ({"stiffness": 1.7e8, "damping": 0.0}, "stiffness = 1.7e+08 N/m with 0.001 kg at the contact; allowed: at most "
                                               "4.85e-07 s, or 1.6e+08 N/m"),
        ({"damping": 2e3}, "damping = 2000 N s/m with 0.001 kg at the contact; allowed: at most 2.5e-07 s, or "
                           "1e+03 N s/m"),
    ],
)  # fmt: skip
def test_a_contact_that_the_internal_step_does_not_resolve_is_refused(values, stated):
    message = f"integration.internal_step = 5e-07 s is too long for backup_bearing.{stated}"
    with pytest.raises(PlantError, match=f"^{re.escape(message)}$"):
        free_rotor(BackupBearingParameters(contact=True, **values), mass=1e-3)
    free_rotor(BackupBearingParameters(contact=False, **values), mass=1e-3)


@pytest.mark.parametrize("damped", [False, True])
def test_at_the_limits_of_the_step_a_bounce_is_that_of_spring_and_damper(damped):
    """With both, rate c / (2 m) and natural frequency sqrt(k / m) make a restitution of 0.1."""
    stiffest, strongest = contact_limits(PlantParameters(rotor=RotorParameters(mass=1e-3)), None)
    damping = strongest if damped else 0.0
    contact = BackupBearingParameters(contact=True, stiffness=stiffest, damping=damping, friction=0.0)
    assert rebound(contact, 1e-3) == (pytest.approx(0.1, abs=0.03) if damped else pytest.approx(1.0, abs=0.008))


def test_at_the_contact_of_a_rotor_in_two_bearings_moves_its_softest_motion():
    """Of a symmetric rigid rotor: half of it in translation, or I_t / (2 z^2) in tilt, whatever is less."""
    for inertia, least in ((0.25, 0.25 / (2.0 * 0.15**2)), (1.0, 12.5 / 2.0)):
        parameters = PlantParameters(
            rotor=RotorParameters(model="rigid"), rigid_rotor=RigidRotorParameters(transverse_inertia=inertia)
        )
        assert contact_mass(parameters, rotor_model(parameters)) == pytest.approx(least)


def test_friction_against_a_turning_journal_drives_it_backwards():
    """On the bottom its surface moves towards +x; sliding all along, a bounce gives it friction times its impulse."""
    friction, arrival = 0.1, 0.05
    plant = free_rotor(
        BackupBearingParameters(contact=True, damping=0.0, friction=friction),
        gravity=0.0,
        initial_y=-249e-6,
        running_speed=50.0,
    )
    plant._arrays.bearings[0]["velocity"][1] = -arrival
    trace = plant.trace((0.0, 0.0), samples=30)
    pressed = trace.contact_force[:, 1] > 1.0
    assert trace.velocity[-1] == pytest.approx([-2.0 * friction * arrival, arrival], rel=0.1)  # the wall is round
    radial = trace.position[pressed] / np.linalg.norm(trace.position[pressed], axis=1, keepdims=True)
    tangent = radial[:, ::-1] * [-1.0, 1.0]  # from +x to +y
    along, outwards = (np.sum(trace.contact_force[pressed] * axis, axis=1) for axis in (tangent, radial))
    assert outwards.max() < 0.0
    np.testing.assert_allclose(along, friction * outwards, rtol=1e-9)


def test_levitated_rotor_comes_back_from_its_backup_bearing():
    """It is hit by a force that the bearing cannot hold, for a while: the force changes its sign every 50 ms."""
    plant = Plant(
        PlantParameters(
            rotor=RotorParameters(external_force_x=600.0, external_force_frequency=10.0),
            backup_bearing=BackupBearingParameters(contact=True),
        )
    )
    controller = PdController(ControllerParameters())
    traces = [plant.trace(controller.update(plant.position, (0.0, 0.0))) for _ in range(1_000)]
    contact = np.array([np.abs(trace.contact_force).max() > 0.0 for trace in traces])
    assert contact.any()
    assert not contact.all()
    assert not plant.delevitated
