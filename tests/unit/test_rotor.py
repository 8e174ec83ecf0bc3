"""Rotors in two bearings: frequencies, whirl, weight and poses of the rigid rotor, and the same rotor as modes."""

import numpy as np
import pytest

from amb_core.ground.errors import PlantError
from amb_core.plant import PlantParameters, RotorParameters
from amb_core.plant.modal_data import ModalData
from amb_core.plant.parameters import FlexibleRotorParameters, RigidRotorParameters
from amb_core.plant.rotor import RotorModel, modal_rotor, rotor_model

STIFFNESS = 3e5  # N/m
SPEED = 200.0  # Hz
TWO_PI = 2.0 * np.pi
BODY = RigidRotorParameters()
UNEVEN = RigidRotorParameters(bearing_a=-0.1, bearing_b=0.25, sensor_a=-0.12, sensor_b=0.2)


def rigid(body: RigidRotorParameters = BODY, running_speed: float = 0.0) -> RotorModel:
    rotor = RotorParameters(model="rigid", running_speed=running_speed)
    return rotor_model(PlantParameters(rotor=rotor, rigid_rotor=body))


def as_modes(body: RigidRotorParameters) -> ModalData:
    """The rigid rotor as four modes of frequency 0."""
    model = rigid(body, running_speed=1.0 / TWO_PI)  # 1 rad/s
    unit_mass = 1.0 / np.sqrt(np.diag(model.mass))
    return ModalData(
        natural_frequencies=np.zeros(4),
        damping_ratios=np.zeros(4),
        bearings=model.bearings * unit_mass,
        sensors=model.sensors * unit_mass,
        unbalance=model.unbalance * unit_mass,
        weight=model.weight * unit_mass / 9.81,
        gyroscopic=model.gyroscopic * np.outer(unit_mass, unit_mass),
    )


# -- frequencies


def test_free_rotor_at_standstill_does_not_vibrate():
    assert rigid().natural_frequencies() == pytest.approx(np.zeros(4), abs=1e-6)


def test_rotor_between_equal_springs_bounces_and_tilts():
    bounce = np.sqrt(2.0 * STIFFNESS / BODY.mass)
    tilt = np.sqrt(STIFFNESS * (BODY.bearing_a**2 + BODY.bearing_b**2) / BODY.transverse_inertia)
    expected = np.array([bounce, bounce, tilt, tilt]) / TWO_PI
    assert rigid().natural_frequencies(STIFFNESS) == pytest.approx(np.sort(expected), rel=1e-9)


def test_springs_may_differ_between_axes():
    softer = np.array([STIFFNESS, 0.25 * STIFFNESS] * 2)
    both = rigid().natural_frequencies(STIFFNESS)
    assert rigid().natural_frequencies(softer) == pytest.approx(np.sort([*both[::2], *(0.5 * both[::2])]), rel=1e-9)


def test_rotor_hinged_in_bearing_a_swings_like_a_physical_pendulum():
    stiff = np.array([1e13, 1e13, STIFFNESS, STIFFNESS])
    inertia = UNEVEN.transverse_inertia + UNEVEN.mass * UNEVEN.bearing_a**2  # about the hinge
    swing = np.sqrt(STIFFNESS * (UNEVEN.bearing_b - UNEVEN.bearing_a) ** 2 / inertia) / TWO_PI
    assert rigid(UNEVEN).natural_frequencies(stiff)[:2] == pytest.approx(swing, rel=1e-6)


def test_free_rotor_nutates_at_the_ratio_of_its_inertias_times_the_speed():
    nutation = BODY.polar_inertia / BODY.transverse_inertia * SPEED
    assert rigid(running_speed=SPEED).natural_frequencies() == pytest.approx([0, 0, 0, nutation], rel=1e-9, abs=1e-6)


def test_gyroscopic_moment_splits_the_conical_mode():
    """I_t w^2 -+ I_p Omega w - k (a^2 + b^2) = 0 for forward and backward whirl."""
    half = 0.5 * BODY.polar_inertia * TWO_PI * SPEED
    restoring = STIFFNESS * (BODY.bearing_a**2 + BODY.bearing_b**2) * BODY.transverse_inertia
    root = np.sqrt(half**2 + restoring)
    conical = np.array([root - half, root + half]) / BODY.transverse_inertia / TWO_PI
    frequencies = rigid(running_speed=SPEED).natural_frequencies(STIFFNESS)
    assert np.abs(frequencies[:, None] - conical).min(axis=0) == pytest.approx([0.0, 0.0], abs=1e-8)


def test_faster_conical_mode_whirls_with_the_rotation():
    """From +x to +y: y follows x by a quarter of a period."""
    model = rigid(running_speed=SPEED)
    stiffness = STIFFNESS * model.bearings.T @ model.bearings
    tilts = slice(2, 4)

    def dynamic(rate: float) -> np.ndarray:
        return stiffness[tilts, tilts] - rate**2 * model.mass[tilts, tilts] + 1j * rate * model.gyroscopic[tilts, tilts]

    frequencies = model.natural_frequencies(STIFFNESS)
    backward, forward = (TWO_PI * frequencies[n] for n in (0, 3))  # the conical pair encloses the bounce
    moment = np.abs(stiffness[2, 2])
    assert np.abs(dynamic(forward) @ [1.0, -1j]).max() < 1e-9 * moment
    assert np.abs(dynamic(backward) @ [1.0, 1j]).max() < 1e-9 * moment


def test_unbalance_turns_with_the_rotor_and_excites_forward_whirl_only():
    """Its force is cos, sin along x, y; the response of an axisymmetric rotor to it is circular."""
    model, rate = rigid(running_speed=SPEED), TWO_PI * SPEED
    stiffness = STIFFNESS * model.bearings.T @ model.bearings
    dynamic = stiffness - rate**2 * model.mass + 1j * rate * model.gyroscopic
    response = np.linalg.solve(dynamic, model.unbalance.T @ [1.0, -1j])
    assert response[1] == pytest.approx(-1j * response[0], rel=1e-12)
    assert response[2:] == pytest.approx([0.0, 0.0], abs=1e-18)


# -- weight and poses


def test_weight_is_shared_by_the_bearings_as_a_lever():
    model = rigid(UNEVEN)
    sag = model.bearings @ np.linalg.solve(STIFFNESS * model.bearings.T @ model.bearings, model.weight)
    span = UNEVEN.bearing_b - UNEVEN.bearing_a
    share_a = UNEVEN.bearing_b / span
    weight = UNEVEN.mass * 9.81
    assert -STIFFNESS * sag == pytest.approx([0.0, weight * share_a, 0.0, weight * (1.0 - share_a)], abs=1e-9 * weight)


@pytest.mark.parametrize("body", [BODY, UNEVEN])
def test_rotor_is_placed_with_both_journals_at_one_point(body: RigidRotorParameters):
    for model in (rigid(body), modal_rotor(as_modes(body), gravity=9.81, running_speed=0.0)):
        pose = model.coordinates_at(30e-6, -50e-6)
        assert model.bearings @ pose == pytest.approx([30e-6, -50e-6] * 2, abs=1e-18)
        assert model.sensors @ pose == pytest.approx([30e-6, -50e-6] * 2, abs=1e-18)


def test_flexible_rotor_is_placed_unbent():
    shapes = np.hstack([as_modes(BODY).bearings, np.kron([[2.0], [2.0]], np.eye(2))])
    data = ModalData(
        natural_frequencies=np.array([0.0, 0.0, 0.0, 0.0, 300.0, 300.0]),
        damping_ratios=np.full(6, 0.01),
        bearings=shapes,
        sensors=shapes,
        unbalance=shapes[:2],
        weight=np.zeros(6),
        gyroscopic=np.zeros((6, 6)),
    )
    pose = modal_rotor(data, gravity=0.0, running_speed=0.0).coordinates_at(30e-6, -50e-6)
    assert shapes @ pose == pytest.approx([30e-6, -50e-6] * 2, rel=1e-12)
    assert pose[4:] == pytest.approx([0.0, 0.0], abs=1e-18)


# -- modes


def test_rigid_rotor_given_as_modes_is_the_same_rotor():
    model = modal_rotor(as_modes(UNEVEN), gravity=9.81, running_speed=SPEED)
    expected = rigid(UNEVEN, SPEED)
    assert model.natural_frequencies(STIFFNESS) == pytest.approx(expected.natural_frequencies(STIFFNESS), rel=1e-9)
    for ours, theirs in ((model.bearings, expected.bearings), (model.sensors, expected.sensors)):
        response = ours @ np.linalg.solve(STIFFNESS * model.bearings.T @ model.bearings, model.weight)
        sag = theirs @ np.linalg.solve(STIFFNESS * expected.bearings.T @ expected.bearings, expected.weight)
        assert response == pytest.approx(sag, abs=1e-12)


def test_modes_are_damped_by_their_ratios():
    data = as_modes(BODY)
    shapes = np.hstack([data.bearings, np.zeros((4, 1))])
    damped = ModalData(
        natural_frequencies=np.append(data.natural_frequencies, 300.0),
        damping_ratios=np.append(data.damping_ratios, 0.02),
        bearings=shapes,
        sensors=shapes,
        unbalance=shapes[:2],
        weight=np.append(data.weight, 0.0),
        gyroscopic=np.zeros((5, 5)),
    )
    poles = modal_rotor(damped, gravity=9.81, running_speed=0.0).poles(STIFFNESS)
    mode = poles[np.argmax(poles.imag)]
    assert np.abs(mode) == pytest.approx(TWO_PI * 300.0)
    assert -mode.real / np.abs(mode) == pytest.approx(0.02)


def test_flexible_rotor_comes_from_the_file_of_its_parameters(tmp_path):
    as_modes(BODY).save(tmp_path / "rotor.npz")
    parameters = PlantParameters(
        rotor=RotorParameters(model="flexible", running_speed=SPEED, gravity=1.0),
        flexible_rotor=FlexibleRotorParameters(modal_data=str(tmp_path / "rotor.npz")),
    )
    model = rotor_model(parameters)
    assert model.coordinate_names == ("mode_1", "mode_2", "mode_3", "mode_4")
    assert model.weight == pytest.approx([0.0, -np.sqrt(BODY.mass), 0.0, 0.0])
    assert model.gyroscopic[2, 3] == pytest.approx(BODY.polar_inertia / BODY.transverse_inertia * TWO_PI * SPEED)


def test_missing_file_of_a_flexible_rotor_is_named(tmp_path):
    parameters = PlantParameters(
        rotor=RotorParameters(model="flexible"),
        flexible_rotor=FlexibleRotorParameters(modal_data=str(tmp_path / "none.npz")),
    )
    with pytest.raises(PlantError, match=r"modal data .*none\.npz: cannot be read: No such file"):
        rotor_model(parameters)
