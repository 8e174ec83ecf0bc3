"""Uncertainty of identified models: against finite differences, repeated experiments and other coordinates."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.signal import lfilter

from amb_core.data.experiments import merge
from amb_core.ground.errors import IdentificationError
from amb_core.identification import (
    IdentificationData,
    StateSpaceModel,
    estimate_uncertainty,
    identify,
    pem,
    response_of,
)
from amb_core.identification.estimate.predictor import innovations, kalman_gain
from amb_core.identification.prediction import first_state, predict
from amb_core.identification.uncertainty import ModelUncertainty
from amb_core.identification.uncertainty.reference import with_reference
from amb_core.loop.control import ControllerParameters

if TYPE_CHECKING:
    from conftest import LinearBearing

NOISE, FORCE = 5e-8, 0.3  # m, N
FREQUENCIES = np.geomspace(5.0, 4_000.0, 20)
PARTS = ("a", "b", "c", "k")


def small_model(order: int, seed: int = 3) -> StateSpaceModel:
    """A stable random model whose predictor is stable too."""
    random = np.random.default_rng(seed)
    a = random.normal(size=(order, order))
    a *= 0.9 / np.max(np.abs(np.linalg.eigvals(a)))
    b, c, g = (random.normal(size=shape) for shape in ((order, 2), (2, order), (order, 2)))
    noise = np.array([[0.02, 0.005], [0.005, 0.01]])
    k = kalman_gain(a, c, 0.05 * g @ g.T, noise, np.zeros((order, 2)))
    zero = np.zeros(2)
    return StateSpaceModel(a, b, c, np.zeros((2, 2)), k, noise, zero, zero, np.zeros(order), 1e-4, method="pem")


def simulated(model: StateSpaceModel, steps: int, seed: int = 0, colour: float = 0.0) -> IdentificationData:
    """The model under white inputs of variance 1; `colour` is the pole of a filter on the innovations."""
    random = np.random.default_rng(seed)
    u, e = random.normal(size=(steps, 2)), random.normal(size=(steps, 2))
    for step in range(1, steps):
        e[step] = colour * e[step - 1] + np.sqrt(1.0 - colour**2) * e[step]
    e = e @ np.linalg.cholesky(model.innovation_covariance).T
    state, y = np.zeros(model.order), np.empty((steps, 2))
    for step in range(steps):
        y[step] = model.c @ state + e[step]
        state = model.a @ state + model.b @ u[step] + model.k @ e[step]
    return IdentificationData.from_arrays(u, y, model.sample_time)


def in_other_coordinates(model: StateSpaceModel, sizes: np.ndarray) -> StateSpaceModel:
    """With states mixed at random; `sizes` are those of the states, so that rounding does not bury the small ones."""
    basis = sizes[:, np.newaxis] * np.random.default_rng(1).normal(size=(model.order, model.order))
    a, b, k = (np.linalg.solve(basis, part) for part in (model.a @ basis, model.b, model.k))
    return replace(model, a=a, b=b, c=model.c @ basis, k=k, initial_state=np.linalg.solve(basis, model.initial_state))


def kalman_model(bearing: LinearBearing) -> StateSpaceModel:
    """The unstable bearing with the gain of the Kalman filter for `NOISE` and `FORCE`."""
    model, push = bearing.model, bearing._matrices[1][:, 2:]
    disturbance, error = push @ push.T * FORCE**2, np.eye(2) * NOISE**2
    gain = kalman_gain(model.a, model.c, disturbance, error, np.zeros((6, 2)))
    return replace(model, k=gain, innovation_covariance=bearing.innovation_covariance(NOISE, FORCE))


@pytest.fixture(scope="module")
def bearing_uncertainty(bearing: LinearBearing) -> ModelUncertainty:
    data = IdentificationData.from_record(bearing.experiment(noise=NOISE, force=FORCE))
    return estimate_uncertainty(kalman_model(bearing), data)


def by_differences(model: StateSpaceModel, data: IdentificationData) -> tuple[np.ndarray, np.ndarray]:
    """Deviations of poles and complex response, from the errors of models that differ in one entry."""
    inputs, outputs = (
        np.array(part - part.mean(axis=0)) for part in (data.experiments[0].inputs, data.experiments[0].outputs)
    )
    weight = np.linalg.inv(np.linalg.cholesky(model.innovation_covariance))
    names = (*PARTS, "initial_state")
    step = 1e-6

    def moved(place: int) -> tuple[StateSpaceModel, StateSpaceModel]:
        models = []
        for sign in (1.0, -1.0):
            rest, parts = place, {}
            for name in names:
                part = getattr(model, name).copy()
                if 0 <= rest < part.size:
                    part.ravel()[rest] += sign * step
                rest -= part.size
                parts[name] = part
            models.append(replace(model, **parts))
        return models[0], models[1]

    def errors(one: StateSpaceModel) -> np.ndarray:
        return (innovations(one.a, one.b, one.c, one.k, one.initial_state, inputs, outputs) @ weight.T).ravel()

    def response(one: StateSpaceModel) -> np.ndarray:
        return response_of(one, FREQUENCIES).response.ravel()

    places = sum(getattr(model, name).size for name in names)
    pairs = [moved(place) for place in range(places)]
    jacobian = np.column_stack([(errors(up) - errors(down)) / (2.0 * step) for up, down in pairs])
    root = np.linalg.pinv(jacobian, rcond=1e-7)
    responses = np.column_stack([(response(up) - response(down)) / (2.0 * step) for up, down in pairs]) @ root
    poles = np.column_stack([(up.poles() - down.poles()) / (2.0 * step) for up, down in pairs]) @ root
    return np.linalg.norm(poles, axis=1), np.linalg.norm(responses, axis=1)


@pytest.mark.parametrize("order", [2, 5])
def test_deviations_are_those_of_finite_differences(order: int) -> None:
    model = small_model(order)
    data = simulated(model, 1_000)
    uncertainty = estimate_uncertainty(model, data)
    poles, responses = by_differences(model, data)
    assert np.hypot(*uncertainty.pole_deviations().T) == pytest.approx(
        poles, rel=0.02
    )  # unknowns are counted here only
    response = uncertainty.response(FREQUENCIES)
    both = np.hypot(response.magnitude_deviation, response.magnitude * response.phase_deviation)
    assert both.ravel() == pytest.approx(responses, rel=0.02)


def test_the_covariance_has_the_rank_of_the_model_set(bearing_uncertainty: ModelUncertainty) -> None:
    assert bearing_uncertainty.root.shape == (6 * 6 + 3 * 12, 6 * (2 + 2 + 2))
    scaled = bearing_uncertainty.root / np.linalg.norm(bearing_uncertainty.root, axis=1, keepdims=True)
    assert np.linalg.matrix_rank(scaled, tol=1e-9) == 36


def test_poles_and_responses_do_not_depend_on_coordinates(bearing: LinearBearing) -> None:
    data = IdentificationData.from_record(bearing.experiment(noise=NOISE, force=FORCE))
    model = kalman_model(bearing)
    sizes = np.array([1e-5, 1e-2, 1e-5, 1e-2, 0.5, 0.5])  # m, m/s, m, m/s, A, A
    here, there = (estimate_uncertainty(one, data) for one in (model, in_other_coordinates(model, sizes)))
    assert there.pole_deviations() == pytest.approx(here.pole_deviations(), rel=1e-6, abs=1e-12)
    for name in ("magnitude_deviation", "phase_deviation"):
        one, other = (getattr(uncertainty.response(FREQUENCIES), name) for uncertainty in (here, there))
        assert other == pytest.approx(one, rel=1e-6)
    assert there.inflation == pytest.approx(here.inflation, rel=1e-6)


def test_the_true_bearing_lies_within_its_own_distribution(bearing_uncertainty: ModelUncertainty) -> None:
    assert bearing_uncertainty.inflation == pytest.approx(1.0, abs=0.06)  # 141 batches times 36 directions: 0.02
    assert bearing_uncertainty.distance == pytest.approx(1.0, abs=0.4)  # root mean square of 36
    unstable = bearing_uncertainty.pole_deviations()[:2]
    assert np.all(unstable[:, 0] < 1e-4)
    assert np.all(unstable[:, 1] == 0.0)  # real poles stay real


def test_halves_with_states_of_their_own_know_as_much_as_the_whole() -> None:
    model = small_model(3)
    whole = simulated(model, 4_000)
    halves = merge(whole.split(0.5))
    one, other = (estimate_uncertainty(model, data).pole_deviations() for data in (whole, halves))
    assert other == pytest.approx(one, rel=0.01)


def test_samples_scatter_as_the_deviations_say() -> None:
    model = small_model(3)
    uncertainty = estimate_uncertainty(model, simulated(model, 4_000))
    samples = uncertainty.samples(200, seed=1)
    magnitudes = np.array([response_of(one, FREQUENCIES).magnitude for one in samples])
    expected = uncertainty.response(FREQUENCIES).magnitude_deviation
    assert magnitudes.std(axis=0) == pytest.approx(expected, rel=0.25)  # 200 samples scatter by 5 %
    poles = np.array([np.sort(one.poles().real) for one in samples])
    expected = uncertainty.pole_deviations()[np.argsort(model.poles().real), 0]
    assert poles.std(axis=0) == pytest.approx(expected, rel=0.25)


def test_samples_of_an_unstable_plant_predict_as_well_as_they_should(
    bearing: LinearBearing, bearing_uncertainty: ModelUncertainty
) -> None:
    """Twice the logarithm of the likelihood falls by as much as there are parameters, here 36, in the mean."""
    record = bearing.experiment(noise=NOISE, force=FORCE)
    inputs, outputs = record.current - record.current.mean(axis=0), record.position - record.position.mean(axis=0)
    weight = np.linalg.inv(np.linalg.cholesky(bearing_uncertainty.model.innovation_covariance))

    def squares(one: StateSpaceModel) -> float:
        first = first_state(one, inputs, outputs)
        return float(np.sum((innovations(one.a, one.b, one.c, one.k, first, inputs, outputs) @ weight.T) ** 2))

    samples = bearing_uncertainty.samples(15, seed=1)
    assert all(np.max(np.abs(np.linalg.eigvals(one.a - one.k @ one.c))) < 1.0 for one in samples)
    least = squares(bearing_uncertainty.model)
    assert 30.0 < np.median([squares(one) - least for one in samples]) < 60.0


def test_the_seed_chooses_the_samples(bearing_uncertainty: ModelUncertainty) -> None:
    one, same, other = (bearing_uncertainty.samples(2, seed)[1].a for seed in (7, 7, 8))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


def test_correlated_innovations_show() -> None:
    model = small_model(3)
    white, coloured = (estimate_uncertainty(model, simulated(model, 10_000, colour=pole)) for pole in (0.0, 0.6))
    assert white.inflation == pytest.approx(1.0, abs=0.12)  # 100 batches times 18 directions: 0.033
    assert coloured.inflation > 1.3
    assert white.summary == "no unstable poles"
    assert "innovations are not white and should be taken (robust) as they are" in coloured.summary


def test_means_that_are_no_equilibrium_do_not_pass_for_dynamics() -> None:
    random = np.random.default_rng(5)
    inputs = np.where(np.arange(4_000) < 3_600, 0.0, 1.0)[:, np.newaxis]  # the time constant is 1000 samples
    inputs = inputs + 0.1 * random.normal(size=(4_000, 1))
    slow = lfilter([0.0, 0.001], [1.0, -0.999], inputs + 0.01 * random.normal(size=(4_000, 1)), axis=0)
    data = IdentificationData.from_arrays(inputs, slow + 1e-5 * random.normal(size=(4_000, 1)), 1e-4)
    identification = identify(data, 1, drift="none")
    (residuals,) = predict(identification.model, data).residuals
    assert abs(residuals.mean()) < 3.0 * residuals.std() / np.sqrt(4_000)
    assert identification.uncertainty is not None
    (pole,) = identification.model.poles()
    assert abs(pole - 0.999) < 3.0 * identification.uncertainty.pole_deviations()[0, 0] < 1e-4


def test_colour_that_the_order_has_no_state_for_widens_the_bands() -> None:
    random = np.random.default_rng(7)
    inputs = random.normal(size=(6_000, 1))
    slow = lfilter([1.0], [1.0, -0.97], random.normal(size=(6_000, 1)), axis=0)  # forces through the plant
    outputs = lfilter([0.0, 0.1], [1.0, -0.95], inputs + slow, axis=0) + 0.05 * random.normal(size=(6_000, 1))
    data = IdentificationData.from_arrays(inputs, outputs, 1e-4)
    identification = identify(data, 1, drift="none").uncertainty
    assert identification is not None
    frequency = np.geomspace(20.0, 2_000.0, 20)
    z = np.exp(2j * np.pi * frequency * 1e-4)
    true = np.abs(0.1 / (z - 0.95))

    def held(uncertainty: ModelUncertainty) -> float:
        low, high = uncertainty.response(frequency).magnitude_band(0.95) or (true, true)
        return float(np.mean((low[:, 0, 0] <= true) & (true <= high[:, 0, 0])))

    assert held(replace(identification, root=identification.root[:, :-1], reference=None)) < 0.6
    assert held(identification) > 0.9
    assert "bands are widened: a model of order 2 from the same data differs" in identification.summary


@pytest.fixture
def decoupled() -> ModelUncertainty:
    """Of two axes that do not see each other, though the data leave it open that they do."""
    axes, zero = np.eye(2), np.zeros((2, 2))
    model = StateSpaceModel(
        np.diag([0.9, 0.8]), 0.1 * axes, axes, zero, 0.1 * axes, axes, zero[0], zero[0], zero[0], 1e-4, method="pem"
    )
    return ModelUncertainty(model, 1e-4 * np.random.default_rng(2).normal(size=(16, 12)), 1.0, 0.0, False)


def test_an_entry_of_the_response_that_is_zero_deviates_in_any_direction(decoupled: ModelUncertainty) -> None:
    coupled = replace(decoupled, model=replace(decoupled.model, b=decoupled.model.b + 1e-9))
    zero, small = (uncertainty.response(FREQUENCIES) for uncertainty in (decoupled, coupled))
    assert not np.any(zero.response[:, 0, 1])
    either_way = np.hypot(small.magnitude_deviation, small.magnitude * small.phase_deviation)[:, 0, 1]
    assert zero.magnitude_deviation[:, 0, 1] == pytest.approx(either_way / np.sqrt(2.0), rel=1e-4)
    assert zero.phase_deviation[:, 0, 1] == pytest.approx(np.pi)  # nothing is known of it


def test_a_richer_model_differs_by_chance_from_one_whose_axes_do_not_see_each_other(
    decoupled: ModelUncertainty,
) -> None:
    changed = decoupled.model.b + 1e-4 * np.random.default_rng(3).normal(size=(2, 2))
    richer = replace(decoupled, model=replace(decoupled.model, b=changed))
    counted = with_reference(decoupled, richer)
    assert counted.difference < 1.0
    assert np.isfinite(counted.root).all()
    assert np.isfinite(counted.response(FREQUENCIES).magnitude_deviation).all()
    assert counted.widened == ""


def test_the_summary_names_the_unstable_poles_and_other_data(
    bearing: LinearBearing, bearing_uncertainty: ModelUncertainty
) -> None:
    assert bearing_uncertainty.summary == ("unstable poles z = 1.023244 ± 2e-05, 1.022704 ± 2e-05 at 99 %")
    wrong = replace(bearing_uncertainty.model, b=1.01 * bearing_uncertainty.model.b)
    data = IdentificationData.from_record(bearing.experiment(noise=NOISE, force=FORCE))
    assert "not the model that predicts these data best" in estimate_uncertainty(wrong, data).summary


@pytest.mark.slow
@pytest.mark.parametrize("colour", [0.0, 0.95])
def test_repeated_experiments_scatter_as_predicted(colour: float) -> None:
    """With coloured innovations order 2 does not suffice; the estimates scatter about the best model of order 2."""
    model, magnitudes, deviations = small_model(2), [], {False: [], True: []}
    for seed in range(30):
        data = simulated(model, 4_000, seed, colour)
        fit = pem(data.experiments[0].inputs, data.experiments[0].outputs, model)
        magnitudes.append(response_of(fit, FREQUENCIES).magnitude)
        for robust, predicted in deviations.items():
            predicted.append(estimate_uncertainty(fit, data, robust=robust).response(FREQUENCIES).magnitude_deviation)
    ratios = {
        robust: np.sqrt(np.mean(np.square(predicted), axis=0)) / np.std(magnitudes, axis=0)
        for robust, predicted in deviations.items()
    }
    trusted = ratios.values() if colour == 0.0 else [ratios[True]]
    for ratio in trusted:  # the scatter of 30 runs is known to 13 %
        assert np.median(ratio) == pytest.approx(1.0, abs=0.3)
        assert np.all((ratio > 0.65) & (ratio < 1.55))
    if colour:
        assert ratios[False].min() < 0.55  # far too sure of itself


def test_samples_that_leave_no_freedom_are_refused() -> None:
    """Of 3 states, 2 inputs and 2 outputs: 18 parameters, 3 initial states and 2 constants need 23 values."""
    model = small_model(3)
    with pytest.raises(IdentificationError, match="11 samples are too few for the 23 unknowns of order 3"):
        estimate_uncertainty(model, simulated(model, 500).window(0, 11))


def test_what_does_not_suit_is_refused(bearing: LinearBearing) -> None:
    model = small_model(3)
    data = simulated(model, 500)
    with pytest.raises(IdentificationError, match=r"stable predictor; its spectral radius is 1\.02"):
        estimate_uncertainty(bearing.model, data)  # without Kalman gain
    with pytest.raises(IdentificationError, match=r"the sample time 0\.0001 s, the data 0\.001 s"):
        estimate_uncertainty(model, replace(data, sample_time=1e-3))
    with pytest.raises(IdentificationError, match="2 inputs and 2 outputs, the data 1 and 2"):
        estimate_uncertainty(model, data.select(inputs=["u1"]))
    with pytest.raises(IdentificationError, match="9 samples are too few for the 23 unknowns"):
        estimate_uncertainty(model, data.window(0, 9))
    with pytest.raises(IdentificationError, match="the data do not determine how accurate the model of order 3 is"):
        estimate_uncertainty(replace(model, innovation_covariance=np.zeros((2, 2))), data)


def test_a_state_that_the_data_do_not_see_is_refused() -> None:
    model = small_model(3)
    unseen = replace(model, c=model.c * [1.0, 1.0, 0.0], a=np.diag([0.5, 0.3, 0.1]), k=np.zeros((3, 2)))
    with pytest.raises(IdentificationError, match="lower the order"):
        estimate_uncertainty(unseen, simulated(model, 500))


@pytest.mark.filterwarnings("error")
def test_a_model_of_data_without_noise_says_why_its_uncertainty_is_not_known(bearing: LinearBearing) -> None:
    data = IdentificationData.from_record(bearing.experiment(0.0, kind="multisine", duration=0.6))
    result = identify(data, 8, controller=ControllerParameters())
    assert result.uncertainty is None
    assert result.no_uncertainty_because.startswith("the data cannot distinguish the parameters of a model of order 8")
    assert result.summary.endswith(f"uncertainty not known: {result.no_uncertainty_because}")


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("seed", [1, 2, 11])
def test_an_uncertainty_that_overflows_is_not_known_and_causes_no_warnings(
    seed: int, capfd: pytest.CaptureFixture[str]
) -> None:
    """An output that is its input one sample later leaves no noise, and states without an effect.

    Rounding, which differs between processors, decides what is seen first.
    """
    u = 0.4 * np.random.default_rng(seed).normal(size=(1_500, 1))
    data = IdentificationData.from_arrays(
        u, np.vstack([[[0.0]], u[:-1]]), 1e-3, input_names=["u"], output_names=["y"], input_units=["V"],
        output_units=["V"],
    )  # fmt: skip
    result = identify(data, 4)
    shown = capfd.readouterr()
    assert "DLASCL" not in shown.out + shown.err
    said = result.no_uncertainty_because
    overflows = said.startswith("the data do not determine how accurate the model of order 4 is")
    assert said.endswith(
        "derivatives of its predictions are not finite" if overflows else "excite all axes independently"
    )
