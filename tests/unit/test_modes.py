"""Modes of linear models against closed forms: rates, whirl, shapes names; pairs of identified and computed ones."""

from dataclasses import replace

import numpy as np
import pytest

from amb_core.ground.errors import IdentificationError
from amb_core.identification.modes import closed_loop_modes
from amb_core.linear import LinearSystem
from amb_core.linear.model.mode_pairs import pair_modes
from amb_core.linear.model.modes import Modes, modes_of
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.linear.model.whirl import ellipticity, sensor_planes, whirl_of
from amb_core.linear.sampling import discretised
from amb_core.loop.control import ControllerParameters
from amb_core.plant import Plant, PlantParameters, RigidRotorParameters, RotorParameters, linearize, uniform_shaft
from amb_core.plant.rotor import RotorModel, modal_rotor, rigid_rotor

SAMPLE_TIME = 1e-4
STIFFNESS, DAMPING, ARM = 1.0e6, 300.0, 0.15  # N/m and N s/m of each bearing, m
MASS, TRANSVERSE, POLAR = 12.5, 0.25, 0.05
AXES = ["x_a", "y_a", "x_b", "y_b"]


def on_springs(rotor: RotorModel, stiffness=STIFFNESS, damping=DAMPING, rotation: np.ndarray | None = None) -> Modes:
    """Modes of a rotor on the same spring and damper in every axis of both bearings, forces there held over samples."""
    n, at = rotor.n, rotor.bearings
    bearing = np.broadcast_to(stiffness, 4), np.broadcast_to(damping, 4)
    rates = np.linalg.solve(
        rotor.mass,
        np.hstack(
            [
                -(rotor.stiffness + (at.T * bearing[0]) @ at),
                -(rotor.damping + rotor.gyroscopic + (at.T * bearing[1]) @ at),
                at.T,
            ]
        ),
    )
    a = np.vstack([np.eye(n, 2 * n, k=n), rates[:, : 2 * n]])
    b = np.vstack([np.zeros((n, 4)), rates[:, 2 * n :]])
    c = np.hstack([rotor.sensors, np.zeros((4, n))])
    held = discretised(LinearSystem(a, b, c, np.zeros((4, 4)), 0.0, output_names=AXES), SAMPLE_TIME)
    if rotation is not None:  # other coordinates of the state
        held = held.with_matrices(rotation @ held.a @ rotation.T, rotation @ held.b, held.c @ rotation.T, held.d)
    return modes_of(held)


def rigid(running_speed: float) -> RotorModel:
    body = RigidRotorParameters(
        mass=MASS, transverse_inertia=TRANSVERSE, polar_inertia=POLAR,
        bearing_a=-ARM, bearing_b=ARM, sensor_a=-ARM, sensor_b=ARM,
    )  # fmt: skip
    rotor = RotorParameters(model="rigid", running_speed=running_speed)
    return rigid_rotor(PlantParameters(rotor=rotor, rigid_rotor=body))


def tilt_rates(running_speed: float) -> tuple[complex, complex]:
    """Forward and backward root of I_t s^2 + (2 d l^2 - j I_p Omega) s + 2 k l^2 = 0, tilt_x + j tilt_y ~ e^st."""
    roots = np.roots([TRANSVERSE, 2 * DAMPING * ARM**2 - 2j * np.pi * POLAR * running_speed, 2 * STIFFNESS * ARM**2])
    forward, backward = roots[np.argsort(-roots.imag)]
    return complex(forward), complex(backward)


@pytest.mark.parametrize("running_speed", [50.0, 200.0, 400.0])
def test_rigid_rotor_has_the_rates_of_its_closed_form(running_speed):
    modes = on_springs(rigid(running_speed))
    translation = np.roots([MASS, 2 * DAMPING, 2 * STIFFNESS])[0]
    expected = complex(translation.real, abs(translation.imag))
    for mode in modes.of_kind("translation"):
        assert mode.rate == pytest.approx(expected, rel=1e-7)
        assert mode.natural_hz == pytest.approx(np.sqrt(2 * STIFFNESS / MASS) / (2 * np.pi), rel=1e-7)
    assert len(modes.of_kind("translation")) == 2
    (nutation,), (precession,) = modes.of_kind("nutation"), modes.of_kind("precession")
    forward, backward = tilt_rates(running_speed)
    assert nutation.rate == pytest.approx(forward, rel=1e-7)
    assert precession.rate == pytest.approx(backward.conjugate(), rel=1e-7)
    assert (nutation.whirl, precession.whirl) == ("forward", "backward")
    assert nutation.natural_hz > precession.natural_hz


def test_the_nutation_is_a_circle_in_opposite_phase_at_the_bearings():
    (nutation,) = on_springs(rigid(200.0)).of_kind("nutation")
    ratio = nutation.shape / nutation.shape[0]
    np.testing.assert_allclose(ratio, [1.0, -1.0j, -1.0, 1.0j], atol=1e-6)  # y follows x by 90 degrees


def test_at_standstill_the_modes_are_planar_whatever_the_eigenvectors():
    rotation = np.linalg.qr(np.random.default_rng(3).normal(size=(8, 8)))[0]
    modes = on_springs(rigid(0.0), rotation=rotation)
    assert [mode.kind for mode in modes.modes] == ["translation", "translation", "tilt", "tilt"]
    for mode in modes.modes:
        assert mode.whirl == "planar"
        size = np.sort(np.abs(mode.shape))
        np.testing.assert_allclose(size, [0.0, 0.0, 1.0, 1.0], atol=1e-6)  # along x, or along y


def test_unequal_bearings_make_the_orbits_ellipses_of_the_same_directions():
    stiff_along_y = np.array([1.0, 1.1, 1.0, 1.1]) * STIFFNESS
    modes = on_springs(rigid(200.0), stiffness=stiff_along_y)
    (nutation,) = modes.of_kind("nutation")
    plane = sensor_planes(modes.output_names)[0]
    assert 0.05 < ellipticity(nutation.shape, plane) < 0.95
    assert len(modes.of_kind("precession")) == 1
    assert [mode.whirl for mode in modes.of_kind("translation")] == ["planar", "planar"]


def test_overdamped_rotor_has_real_modes_that_do_not_whirl():
    modes = on_springs(rigid(0.0), damping=20_000.0)
    assert len(modes.modes) == 8
    assert {mode.whirl for mode in modes.modes} == {"none"}
    assert {mode.kind for mode in modes.modes} == {"translation", "tilt"}
    assert all(mode.damping_ratio == 1.0 and mode.damped_hz == 0.0 for mode in modes.modes)


def test_free_free_shaft_on_soft_springs_has_the_bending_of_the_closed_form():
    length, diameter, density, modulus = 0.8, 0.05, 7850.0, 2.1e11
    data = uniform_shaft(length, diameter, (-0.35, 0.35), bending_modes=2, damping_ratio=0.01)
    modes = on_springs(modal_rotor(data, 9.81, 0.0), stiffness=1e4, damping=10.0)
    first = modes.of_kind("bending")[0]
    mass = density * np.pi * diameter**2 / 4 * length
    beam = 22.3733 / (2 * np.pi) * np.sqrt(modulus * np.pi * diameter**4 / 64 / (mass * length**3))
    assert first.natural_hz == pytest.approx(beam, rel=1e-3)  # the springs raise it by half their share of its energy
    assert first.damping_ratio == pytest.approx(0.01, rel=0.1)
    assert len(modes.of_kind("bending")) == 4
    assert [mode.kind for mode in modes.modes[:4]] == ["translation", "translation", "tilt", "tilt"]


def test_rigid_modes_keep_their_names_beside_bending_modes_of_hardly_any_damping():
    """Their velocities are a hundred times as large."""
    data = uniform_shaft(0.6, 0.06, (-0.2, 0.2), bending_modes=3, damping_ratio=1e-5)
    modes = on_springs(modal_rotor(data, 9.81, 100.0), damping=1.0)
    kinds = [mode.kind for mode in modes.modes]
    assert sorted(kinds[:4]) == ["nutation", "precession", "translation", "translation"]
    assert kinds[4:] == ["bending"] * 6


def test_bending_splits_forward_and_backward_at_speed():
    data = uniform_shaft(0.6, 0.1, (-0.25, 0.25), bending_modes=1, damping_ratio=0.002)
    modes = on_springs(modal_rotor(data, 9.81, 300.0), stiffness=1e5, damping=100.0)
    backward, forward = modes.of_kind("bending")
    assert (backward.whirl, forward.whirl) == ("backward", "forward")


@pytest.mark.parametrize(
    ("shape", "whirl"),
    [
        ([1.0, -1.0j, 1.0, -1.0j], "forward"),
        ([1.0, 0.5j, 1.0, 0.5j], "backward"),
        ([1.0, 0.7, -0.4, -0.3], "planar"),
        ([1.0, -1.0j, 1.0, 1.0j], "mixed"),
        ([1.0, -1.0j, 1e-3, 1e-3j], "forward"),  # B is a node
        ([1.0 + 1.0j, 1.0 - 1.0j, 0.0, 0.0], "forward"),  # at any phase
    ],
)
def test_whirl_is_that_of_the_larger_circle_in_every_plane_that_moves(shape, whirl):
    assert whirl_of(np.array(shape, dtype=complex), sensor_planes(AXES)) == whirl


def test_an_orbit_drawn_over_time_turns_as_the_mode_says():
    (nutation,) = on_springs(rigid(200.0)).of_kind("nutation")
    time = np.linspace(0.0, 0.2 / nutation.damped_hz, 50)
    x, y = (np.real(nutation.shape[axis] * np.exp(nutation.rate * time)) for axis in (0, 1))
    assert np.all(np.diff(np.unwrap(np.arctan2(y, x))) > 0.0)  # from +x to +y


@pytest.mark.parametrize(
    ("names", "planes"),
    [
        (["x", "y"], [("", 0, 1)]),
        (["x_a", "y_a", "x_b", "y_b", "z"], [("a", 0, 1), ("b", 2, 3)]),
        (["y"], []),
        (["temperature", "xenon"], []),
    ],
)
def test_planes_are_those_of_the_named_axes(names, planes):
    assert [(plane.name, plane.x, plane.y) for plane in sensor_planes(names)] == planes


def test_negative_stiffness_has_real_modes_alone_and_oscillating_ones_in_the_loop():
    model = linearize(Plant())
    plant, loop = modes_of(model.discrete).selected(), modes_of(model.closed_loop).selected()
    assert [mode.kind for mode in plant.modes] == ["translation"] * 4
    assert sum(not mode.stable for mode in plant.modes) == 2
    assert plant.stable is False
    assert all(mode.whirl == "none" for mode in plant.modes)
    along_x = next(mode for mode in loop.modes if abs(mode.shape[0]) == pytest.approx(1.0))
    expected = model.rigid_mode("x")
    assert along_x.natural_hz == pytest.approx(expected.natural_hz, rel=1e-9)
    assert along_x.damping_ratio == pytest.approx(expected.damping_ratio, rel=1e-9)
    assert loop.stable
    assert [mode.whirl for mode in loop.modes] == ["planar", "planar"]


@pytest.mark.parametrize("pole", [-1.5, -1.0, -0.9])
def test_a_pole_without_a_mode_decides_on_stability_too(pole):
    """A negative real pole alternates at half the sample rate: no mode of the samples shows it."""
    one = np.eye(1)
    modes = modes_of(LinearSystem(np.diag([0.5, pole]), np.ones((2, 1)), np.ones((1, 2)), 0.0 * one, SAMPLE_TIME))
    assert len(modes.modes) == 1
    assert modes.stable == modes.selected().stable == (pole > -1.0)
    assert modes.unstable_without_mode == (pole <= -1.0)


def test_a_table_in_json_has_a_row_per_mode():
    entries = on_springs(rigid(200.0)).to_json()
    nutation = next(entry for entry in entries if entry["kind"] == "nutation")
    assert nutation["orbit"] == pytest.approx({"a": 1.0, "b": 1.0}, abs=1e-6)
    assert nutation["shape"]["x_b"][0] == pytest.approx(1.0, rel=1e-6)
    assert nutation["damped_hz"] < nutation["natural_hz"]


# -- pairs


def identified(system: LinearSystem, seed: int = 0, noise: float = 0.0) -> StateSpaceModel:
    """The system in other coordinates, as an identified model with small errors in every element."""
    rng = np.random.default_rng(seed)
    n, p = system.order, system.outputs
    rotation = np.linalg.qr(rng.normal(size=(n, n)))[0]

    def bent(matrix: np.ndarray) -> np.ndarray:
        return matrix * (1.0 + noise * rng.normal(size=matrix.shape))

    return StateSpaceModel(
        a=rotation @ bent(system.a) @ rotation.T, b=rotation @ bent(system.b), c=bent(system.c) @ rotation.T,
        d=np.zeros((p, system.inputs)), k=np.zeros((n, p)), innovation_covariance=np.eye(p),
        input_offset=np.zeros(system.inputs), output_offset=np.zeros(p), initial_state=np.zeros(n),
        sample_time=system.sample_time, input_names=system.input_names, output_names=system.output_names,
    )  # fmt: skip


@pytest.fixture(scope="module")
def paper():
    return linearize(Plant())


def test_modes_of_the_same_model_in_other_coordinates_pair_without_error(paper):
    comparison = pair_modes(
        closed_loop_modes(identified(paper.discrete), paper.controller), modes_of(paper.closed_loop)
    )
    assert [pair.computed.kind for pair in comparison.pairs] == ["translation", "translation"]
    assert not comparison.missing
    assert not comparison.surplus
    assert comparison.worst("translation") < 1e-6
    assert all(pair.assurance == pytest.approx(1.0, abs=1e-6) for pair in comparison.pairs)
    assert comparison.pairs[0].to_json()["frequency_error_percent"] == pytest.approx(0.0, abs=1e-4)


def test_modes_alike_along_x_and_y_pair_in_any_mixture():
    computed = on_springs(rigid(0.0))
    turned = [mode.shape.reshape(2, 2) @ np.array([[0.8, 0.6], [-0.6, 0.8]]) for mode in computed.modes]
    other = replace(
        computed,
        modes=tuple(replace(mode, shape=shape.ravel()) for mode, shape in zip(computed.modes, turned, strict=True)),
    )
    comparison = pair_modes(other, computed)
    assert len(comparison.pairs) == 4
    assert comparison.worst("tilt", "translation") == 0.0


def test_modes_of_another_shape_or_a_distant_rate_are_not_paired():
    computed, softer = on_springs(rigid(200.0)), on_springs(rigid(200.0), stiffness=0.6 * STIFFNESS)
    comparison = pair_modes(softer, computed)
    assert not comparison.pairs
    assert len(comparison.missing) == len(comparison.surplus) == 4
    assert comparison.worst("nutation") is None


def test_a_rotor_a_little_off_has_the_errors_of_its_closed_form():
    computed, stiffer = on_springs(rigid(200.0)), on_springs(rigid(200.0), stiffness=1.02 * STIFFNESS)
    comparison = pair_modes(stiffer, computed)
    assert len(comparison.pairs) == 4
    assert comparison.worst("translation") == pytest.approx(np.sqrt(1.02) - 1.0, rel=1e-5)


def test_modes_at_other_outputs_are_refused(paper):
    with pytest.raises(IdentificationError, match="cannot be paired with modes at x, y"):
        pair_modes(on_springs(rigid(0.0)), modes_of(paper.closed_loop))


def test_a_controller_of_another_rate_is_refused(paper):
    with pytest.raises(IdentificationError, match="must have one sample time"):
        closed_loop_modes(identified(paper.discrete), ControllerParameters(sample_rate=20_000.0))
