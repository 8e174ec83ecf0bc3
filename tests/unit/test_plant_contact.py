"""The backup bearing: rest, bounce, friction, and a rotor that comes back."""

import numpy as np
import pytest

from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import AmplifierParameters, Plant, PlantParameters, RotorParameters
from amb_core.plant.parameters import BackupBearingParameters
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
