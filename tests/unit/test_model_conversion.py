"""Models leave for other tools: as MATLAB files, in continuous time, reduced within bounds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import control
import ctrlsys
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import io
from scipy.linalg import block_diag
from scipy.signal import dlsim

from amb_core.ground.errors import IdentificationError
from amb_core.identification import StateSpaceModel, reduce_balanced, to_continuous, to_predictor, to_scipy

if TYPE_CHECKING:
    from conftest import LinearBearing


def test_a_mat_file_has_what_matlab_and_octave_need(bearing: LinearBearing, tmp_path: Path) -> None:
    bearing.model.save(tmp_path / "model.mat")
    content = io.loadmat(tmp_path / "model.mat")
    assert np.array_equal(content["A"], bearing.model.a)
    assert content["X0"].shape == (6, 1)
    assert content["Ts"].item() == bearing.sample_time
    assert [str(name.item()) for name in content["InputName"].ravel()] == ["i_x", "i_y"]
    assert [str(unit.item()) for unit in content["OutputUnit"].ravel()] == ["m", "m"]


def test_an_idss_of_matlab_is_a_model(bearing: LinearBearing, tmp_path: Path) -> None:
    """`save model.mat A B C D K Ts InputName OutputName`, whose names are cells with one column."""
    model = noisy(bearing)
    names = {"InputName": [["i_x"], ["i_y"]], "OutputName": [["x"], ["y"]]}
    cells = {name: np.array(value, dtype=object) for name, value in names.items()}
    matrices = {name: getattr(model, name.lower()) for name in "ABCDK"}
    io.savemat(tmp_path / "model.mat", {**matrices, **cells, "Ts": model.sample_time})
    read = StateSpaceModel.load(tmp_path / "model.mat")
    assert all(np.array_equal(getattr(read, name), getattr(model, name)) for name in "abcdk")
    assert (read.input_names, read.output_names, read.sample_time) == (("i_x", "i_y"), ("x", "y"), model.sample_time)
    assert (read.input_units, read.output_units) == (("A", "A"), ("m", "m"))
    assert not any(part.any() for part in (read.input_offset, read.output_offset, read.initial_state))
    del matrices["K"]
    io.savemat(tmp_path / "plant.mat", {**matrices, **cells, "Ts": model.sample_time})
    assert not StateSpaceModel.load(tmp_path / "plant.mat").k.any(), "an ss, which has no noise"


def test_a_numpy_archive_may_hold_a_model_under_the_names_of_matlab(bearing: LinearBearing, tmp_path: Path) -> None:
    matrices = {name: getattr(bearing.model, name.lower()) for name in "ABCD"} | {"Ts": bearing.sample_time}
    np.savez(tmp_path / "plant.npz", **matrices, InputName=["i_x", "i_y"], OutputName=["x", "y"])
    read = StateSpaceModel.load(tmp_path / "plant.npz")
    assert all(np.array_equal(getattr(read, name), getattr(bearing.model, name)) for name in "abcd")
    assert (read.input_names, read.output_names) == (("i_x", "i_y"), ("x", "y"))
    np.savez(tmp_path / "one.npz", A=0.9, B=[[1.0]], C=[[1.0]], D=0.0, Ts=1e-3, InputName=["current"], OutputName=["x"])
    assert StateSpaceModel.load(tmp_path / "one.npz").input_names == ("current",)
    np.savez(tmp_path / "nameless.npz", **matrices)
    with pytest.raises(IdentificationError, match=r"nameless\.npz: lacks InputName, OutputName; a model is A, B"):
        StateSpaceModel.load(tmp_path / "nameless.npz")


def test_a_mat_file_without_a_model_is_refused_in_one_line(tmp_path: Path) -> None:
    io.savemat(tmp_path / "other.mat", {"A": np.eye(2)})
    (tmp_path / "damaged.mat").write_bytes((tmp_path / "other.mat").read_bytes()[:150])
    for name, reason in (
        ("other", "lacks B, C, D, Ts, InputName, OutputName; a model is .*; found A"),
        ("damaged", "(is damaged or of another kind|cannot be read)"),
    ):
        with pytest.raises(IdentificationError, match=rf"model .*{name}\.mat: {reason}") as refusal:
            StateSpaceModel.load(tmp_path / f"{name}.mat")
        assert "\n" not in str(refusal.value)


# -- SciPy, predictor


def noisy(bearing: LinearBearing) -> StateSpaceModel:
    """The bearing with the gain of its Kalman filter."""
    a, c = bearing.model.a, bearing.model.c
    gain = control.dlqr(a.T, c.T, 1e-3 * np.eye(6), 1e-12 * np.eye(2))[0].T
    return replace(bearing.model, k=gain, initial_state=np.arange(6.0) * 1e-6)


def test_scipy_simulates_the_deterministic_part(bearing: LinearBearing) -> None:
    u = np.random.default_rng(0).normal(size=(50, 2))
    state, expected = np.zeros(6), np.empty((50, 2))
    for step in range(50):
        expected[step] = bearing.model.c @ state
        state = bearing.model.a @ state + bearing.model.b @ u[step]
    system = to_scipy(bearing.model)
    assert system.dt == bearing.sample_time
    np.testing.assert_allclose(dlsim(system, u)[1], expected, rtol=1e-9, atol=1e-15)


def test_the_predictor_is_stable_and_turns_its_own_predictions_into_the_model(bearing: LinearBearing) -> None:
    model = noisy(bearing)
    system = to_predictor(model)
    assert np.abs(system.poles()).max() < 1.0 < np.abs(model.poles()).max()
    assert system.input_labels == ["i_x", "i_y", "x", "y"]
    assert system.output_labels == ["x_predicted", "y_predicted"]
    closed = system.A + system.B[:, 2:] @ system.C  # with no prediction error, y = yhat
    np.testing.assert_allclose(closed, model.a, atol=1e-9 * np.abs(model.k).max())


# -- continuous time


def test_the_continuous_system_has_the_physical_poles(bearing: LinearBearing) -> None:
    poles = np.sort(to_continuous(bearing.model).poles().real)
    rates = [np.sqrt(stiffness / bearing.mass) for stiffness in (bearing.stiffness_x, bearing.stiffness_y)]
    cutoffs = [2.0 * np.pi * bandwidth for bandwidth in (1_500.0, 2_000.0)]
    assert poles == pytest.approx(np.sort([*rates, *(-rate for rate in rates), *(-c for c in cutoffs)]), rel=1e-6)


@given(seed=st.integers(0, 1_000), n=st.integers(1, 6))
@settings(max_examples=12, deadline=None)
def test_sampling_the_continuous_system_gives_the_model_back(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    a = 200.0 * rng.normal(size=(n, n))
    sampled = control.StateSpace(a, rng.normal(size=(n, 2)), rng.normal(size=(2, n)), np.zeros((2, 2))).sample(1e-3)
    model = replace(
        blank(n), a=sampled.A, b=sampled.B, c=sampled.C, initial_state=np.zeros(n), k=np.zeros((n, 2)), sample_time=1e-3
    )
    again = to_continuous(model)
    assert again.isctime()
    assert (again.input_labels, again.output_labels) == (["i_x", "i_y"], ["x", "y"])
    np.testing.assert_allclose(again.A, a, atol=1e-5 * np.abs(a).max())
    np.testing.assert_allclose(again.sample(1e-3).B, model.b, atol=1e-9 * np.abs(model.b).max())


def blank(n: int) -> StateSpaceModel:
    return StateSpaceModel(
        0.5 * np.eye(n), np.zeros((n, 2)), np.zeros((2, n)), np.zeros((2, 2)), np.zeros((n, 2)), np.eye(2),
        np.zeros(2), np.zeros(2), np.zeros(n), 1e-4,
    )  # fmt: skip


def test_an_integrator_has_a_continuous_time_system() -> None:
    model = replace(blank(2), a=[[1.0, 1e-4], [0.0, 1.0]], b=[[5e-9, 0.0], [1e-4, 0.0]])
    np.testing.assert_allclose(to_continuous(model).A, [[0.0, 1.0], [0.0, 0.0]], atol=1e-9)
    np.testing.assert_allclose(to_continuous(model).B[:, 0], [0.0, 1.0], atol=1e-9)


@pytest.mark.parametrize(
    ("a", "message"),
    [
        (np.diag([0.5, -0.3]), "a pole at z = -0.3, on the negative real axis, which no real continuous-time system"),
        (np.diag([-0.3, -0.3]), "a pole at z = -0.3, on the negative real axis"),
        (np.diag([0.5, 0.0]), r"a pole at z = 0, a dead time, .* remove dead time from the data \(advance_inputs\)"),
        (np.array([[0.0, 1.0], [0.0, 0.0]]), "a pole at z = 0, a dead time"),
    ],
)
def test_a_model_without_a_real_logarithm_says_why(a: np.ndarray, message: str) -> None:
    with pytest.raises(IdentificationError, match=message):
        to_continuous(replace(blank(2), a=a))


# -- balanced reduction


def with_more_states(bearing: LinearBearing) -> StateSpaceModel:
    """The bearing and four stable modes that matter little, in coordinates that mix all states."""
    rng = np.random.default_rng(3)
    modes = block_diag(0.9, -0.4, np.array([[0.5, 0.3], [-0.3, 0.5]]))
    a = block_diag(bearing.model.a, modes)
    b = np.vstack([bearing.model.b, 1e-4 * rng.normal(size=(4, 2))])
    c = np.hstack([bearing.model.c, 1e-4 * rng.normal(size=(2, 4))])
    gain = control.dlqr(a.T, c.T, np.eye(10) * 1e-3, np.eye(2) * 1e-12)[0].T
    mix = np.linalg.qr(rng.normal(size=(10, 10)))[0]
    return replace(
        bearing.model, a=mix @ a @ mix.T, b=mix @ b, c=c @ mix.T, k=mix @ gain, initial_state=mix @ np.arange(10.0)
    )


def frequency_response(model: StateSpaceModel, points: int = 400) -> np.ndarray:
    z = np.exp(1j * np.linspace(1e-4, np.pi, points))
    return np.array(
        [model.c @ np.linalg.solve(point * np.eye(model.order) - model.a, model.b) + model.d for point in z]
    )


@pytest.mark.parametrize("order", [2, 3, 5, 6, 8, 10])
def test_reduction_keeps_unstable_poles_and_stays_within_its_bound(bearing: LinearBearing, order: int) -> None:
    full = with_more_states(bearing)
    reduction = reduce_balanced(full, order)
    model = reduction.model
    assert model.order == order
    assert (reduction.unstable_states, len(reduction.hankel_singular_values)) == (2, 8)
    assert model.unstable_poles() == pytest.approx(full.unstable_poles(), rel=1e-7)
    error = np.linalg.svd(frequency_response(model) - frequency_response(full), compute_uv=False).max()
    assert error <= reduction.error_bound + 1e-9 * np.abs(frequency_response(full)).max()
    assert np.abs(np.linalg.eigvals(model.a - model.k @ model.c)).max() < 1.0
    assert model.method.endswith("reduced from order 10")
    assert model.fit.size == 0


def test_reduction_is_the_one_of_slicot(bearing: LinearBearing) -> None:
    full = with_more_states(bearing)
    a, b, c = (np.asfortranarray(matrix) for matrix in (full.a, full.b, full.c))
    ar, br, cr, stable, hsv, *_ = ctrlsys.ab09md("D", "B", "N", "F", 10, 2, 2, 6, 1.0, a, b, c, 0.0)
    reduction = reduce_balanced(full, 6)
    assert stable == 8
    assert reduction.hankel_singular_values[:6] == pytest.approx(hsv[:6], rel=1e-4)
    theirs = replace(reduction.model, a=ar[:6, :6], b=br[:6], c=cr[:, :6])
    scale = np.abs(frequency_response(theirs)).max()
    np.testing.assert_allclose(frequency_response(reduction.model), frequency_response(theirs), atol=1e-7 * scale)


def test_states_without_effect_go_without_error(bearing: LinearBearing) -> None:
    """Nothing is lost that matters: the response to the innovations and the initial state stays too."""
    full = with_more_states(bearing)
    silent = replace(
        full,
        a=block_diag(full.a, 0.3),
        b=np.vstack([full.b, np.zeros(2)]),
        c=np.hstack([full.c, np.zeros((2, 1))]),
        k=np.vstack([full.k, np.zeros(2)]),
        initial_state=np.append(full.initial_state, 1.0),
    )
    reduction = reduce_balanced(silent, 10)
    assert reduction.error_bound < 1e-12
    for power in range(4):
        transition = np.linalg.matrix_power(reduction.model.a, power)
        expected = np.linalg.matrix_power(full.a, power)
        for name in ("k", "initial_state"):
            markov = reduction.model.c @ transition @ getattr(reduction.model, name)
            right = full.c @ expected @ getattr(full, name)
            np.testing.assert_allclose(markov, right, rtol=1e-4, atol=1e-9 * np.abs(right).max())


@pytest.mark.parametrize("order", [0, 1, 11])
def test_orders_that_cannot_be_had_are_refused(bearing: LinearBearing, order: int) -> None:
    with pytest.raises(
        IdentificationError, match=f"order {order} is not allowed; allowed: 2 to 10, since the model has 2"
    ):
        reduce_balanced(with_more_states(bearing), order)


def test_a_model_that_is_all_unstable_or_all_stable_can_be_given() -> None:
    model = replace(blank(3), a=np.diag([1.1, 1.0, -1.2]), b=np.ones((3, 2)), c=np.ones((2, 3)))
    assert reduce_balanced(replace(model, k=find_gain(model)), 3).error_bound == 0.0
    stable = replace(blank(3), a=np.diag([0.9, 0.5, -0.2]), b=np.eye(3)[:, :2], c=np.eye(3)[:2])
    with pytest.raises(IdentificationError, match="order 3 is not allowed; allowed: 1 to 2"):
        reduce_balanced(stable, 3)
    assert reduce_balanced(stable, 1).error_bound == pytest.approx(2.0 / (1.0 - 0.5**2))


@pytest.mark.parametrize("zero", [1.0, -1.0])
def test_a_reduction_without_a_stabilising_gain_still_predicts(zero: float) -> None:
    """What is left of the noise model has a zero on the unit circle: the Riccati equation has no solution."""
    full = replace(
        blank(2), a=np.diag([0.9, 0.1]), b=np.diag([1.0, 1e-6]), c=np.array([[1.0, 1e-6], [0.0, 0.0]]),
        k=np.array([[0.9 - zero, 0.0], [0.0, 0.0]]),
    )  # fmt: skip
    model = reduce_balanced(full, 1).model
    assert np.abs(np.linalg.eigvals(model.a - model.k @ model.c)).max() < 1.0


def find_gain(model: StateSpaceModel) -> np.ndarray:
    gain: np.ndarray = control.dlqr(model.a.T, model.c.T, np.eye(3), np.eye(2))[0].T
    return gain


def test_an_unstable_predictor_gets_the_gain_of_the_kalman_filter(bearing: LinearBearing) -> None:
    full = replace(with_more_states(bearing), innovation_covariance=np.eye(2))
    weak = replace(full, k=np.zeros((10, 2)) + 1e-3)
    assert np.abs(np.linalg.eigvals(weak.a - weak.k @ weak.c)).max() > 1.0
    model = reduce_balanced(weak, 5).model
    assert np.abs(np.linalg.eigvals(model.a - model.k @ model.c)).max() < 1.0


@pytest.mark.parametrize("lacks", [{"k": np.zeros((10, 2))}, {"innovation_covariance": np.zeros((2, 2))}])
def test_a_model_without_a_noise_model_is_reduced_without_one(bearing: LinearBearing, lacks: dict) -> None:
    full = replace(with_more_states(bearing), innovation_covariance=np.eye(2))
    plant = replace(full, **({"k": np.full((10, 2), 1e-3)} | lacks))  # with an unstable predictor
    reduction = reduce_balanced(plant, 5)
    assert reduction.model.unstable_poles() == pytest.approx(plant.unstable_poles(), rel=1e-7)
    assert bool(np.any(reduction.model.k)) == bool(np.any(plant.k))
