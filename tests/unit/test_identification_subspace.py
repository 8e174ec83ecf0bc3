"""Identification of an unstable bearing from its closed loop, and how data that determine no model are refused."""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import TYPE_CHECKING, get_args

import numpy as np
import pytest

from amb_core.excitation import excitation_from_request, generate
from amb_core.ground.errors import IdentificationError
from amb_core.identification import METHODS, Identification, Method, identify, n4sid
from amb_core.identification.estimate.predictor import fit_input_matrix, innovations
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import Plant
from amb_core.plant.simulation import simulate

if TYPE_CHECKING:
    from conftest import LinearBearing


@functools.cache
def paper_identification() -> Identification:
    """The paper's experiment on the simulated bearing, 50 um on x for 2 s, then on y for 2 s; order 10."""
    square = generate(excitation_from_request("square", {"amplitude": 50e-6, "duration": 4.0}), 10_000.0)
    record = simulate(Plant(), PdController(ControllerParameters()), square.steps, square.samples)
    return identify(record, order=10)


@pytest.mark.slow
def test_the_papers_experiment_gives_a_model_that_fits_in_closed_loop() -> None:
    fit_x, fit_y = paper_identification().model.fit
    assert fit_x >= 98.0
    assert fit_y >= 97.0


def test_the_papers_experiment_gives_two_unstable_real_poles_and_a_stable_closed_loop() -> None:
    result = paper_identification()
    unstable = result.model.unstable_poles()
    assert len(unstable) == 2
    assert np.all(unstable.imag == 0.0)
    assert result.stable


@pytest.mark.parametrize("order", [6, 8, 10])
@pytest.mark.parametrize("noise", [1e-9, 5e-8])
def test_the_unstable_poles_of_the_bearing_are_found(bearing: LinearBearing, order: int, noise: float) -> None:
    identification = identify(bearing.experiment(noise), order, "n4sid").model.unstable_poles()
    # In 1/s the poles are 230 and 225; noise through the feedback lowers the estimates by a few per cent.
    assert np.log(identification) == pytest.approx(np.log(bearing.model.unstable_poles()), rel=0.05)


@pytest.mark.parametrize("method", ["n4sid", "moesp", "cva"])
@pytest.mark.parametrize("order", [6, 8, 10])
def test_a_model_of_a_linear_bearing_is_nearly_perfect_in_closed_loop(
    bearing: LinearBearing, method: str, order: int
) -> None:
    result = identify(bearing.experiment(), order, method)
    assert result.model.method == method
    assert np.all(result.model.fit > 99.9)
    assert result.stable
    (simulation,) = result.simulations
    assert simulation is not None
    assert simulation.steps == result.data.samples


@pytest.mark.parametrize("kind", ["multisine", "prbs", "white_noise", "sweep"])
def test_every_kind_of_excitation_identifies_the_bearing(bearing: LinearBearing, kind: str) -> None:
    amplitude = 10e-6 if kind == "white_noise" else 50e-6
    assert np.all(identify(bearing.experiment(kind=kind, amplitude=amplitude), 10, "n4sid").model.fit > 99.5)


def test_a_model_of_known_order_has_the_frequency_response_of_the_bearing(bearing: LinearBearing) -> None:
    model, truth = identify(bearing.experiment(), 6, "n4sid").model, bearing.model
    for frequency in (1.0, 60.0, 500.0):
        z = np.exp(2j * np.pi * frequency * 1e-4)
        identified, right = (part.c @ np.linalg.solve(z * np.eye(6) - part.a, part.b) for part in (model, truth))
        assert np.max(np.abs(identified - right)) < 0.02 * np.max(np.abs(right))


def test_the_model_keeps_operating_point_and_provenance(bearing: LinearBearing) -> None:
    record = bearing.experiment()
    model = n4sid(record.current, record.position, record.sample_time, 6, source="bags/square")
    assert model.input_offset == pytest.approx(record.current.mean(axis=0))
    assert model.output_offset == pytest.approx(record.position.mean(axis=0))
    assert (model.method, model.source, model.samples) == ("n4sid", "bags/square", record.steps)
    assert not model.d.any()
    assert model.fit.size == 0


def test_the_innovations_of_the_model_are_the_noise_of_the_sensor(bearing: LinearBearing) -> None:
    record = bearing.experiment(5e-8)
    model = n4sid(record.current, record.position, record.sample_time, 6, block_rows=40)
    assert np.sqrt(np.diag(model.innovation_covariance)) == pytest.approx([5e-8, 5e-8], rel=0.1)
    assert np.max(np.abs(np.linalg.eigvals(model.a - model.k @ model.c))) < 1.0


def test_the_same_data_give_the_same_model_bit_for_bit(bearing: LinearBearing) -> None:
    one, other = (identify(bearing.experiment(), 10, "n4sid").model for _ in range(2))
    for name in ("a", "b", "c", "k", "initial_state", "fit"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes()


def test_data_from_amid_a_run_are_identified_as_well(bearing: LinearBearing) -> None:
    record = bearing.experiment(lead=2_000)
    result = identify(record.window(2_000, record.steps - 2_000), 6, "n4sid")
    assert np.all(result.model.fit > 99.9)


def test_the_input_matrix_and_first_state_that_made_the_data_are_recovered() -> None:
    random = np.random.default_rng(3)
    a, b, c = np.array([[1.02, 0.1], [0.0, 0.5]]), random.normal(size=(2, 2)), np.eye(2)
    k = a - 0.3 * np.eye(2)  # predictor poles at 0.3
    state = first = np.array([0.4, -0.2])
    inputs, outputs = random.normal(size=(25_000, 2)), np.empty((25_000, 2))
    for step in range(len(inputs)):
        outputs[step] = c @ state
        state = (a - 0.6 * np.eye(2)) @ state + b @ inputs[step] + 0.6 * outputs[step]
        state = np.clip(state, -1e3, 1e3)
        if np.max(np.abs(state)) >= 1e3:
            inputs, outputs = inputs[:step], outputs[:step]
            break
    b_fitted, _, found_first = fit_input_matrix(a, c, k, inputs, outputs)
    assert b_fitted == pytest.approx(b, abs=1e-9)
    assert found_first[0] == pytest.approx(first, abs=1e-9)
    assert np.max(np.abs(innovations(a, b_fitted, c, k, found_first, inputs, outputs))) < 1e-9 * np.max(np.abs(outputs))


def test_an_order_too_low_for_the_plant_gives_a_bad_fit_and_no_error(
    bearing: LinearBearing,
) -> None:
    result = identify(bearing.experiment(), 1, "n4sid")
    assert not np.any(np.isnan(result.model.fit))
    assert np.min(result.model.fit) < 50.0


@pytest.mark.parametrize(
    ("order", "steps", "message"),
    [
        (0, 20_000, "order 0 is not allowed; allowed: 1 to 40"),
        (41, 20_000, "order 41 is not allowed; allowed: 1 to 40"),
        (4.0, 20_000, "an order of type float is not allowed; allowed: whole numbers from 1 to 40"),
        (True, 20_000, "an order of type bool is not allowed"),
        (10, 60, "60 samples are too few for order 10; at least 119 are needed"),
    ],
)
def test_an_order_that_does_not_suit_the_data_is_refused(
    bearing: LinearBearing, order: int, steps: int, message: str
) -> None:
    record = bearing.experiment().window(0, steps)
    with pytest.raises(IdentificationError, match=message):
        n4sid(record.current, record.position, record.sample_time, order, round(1.2 * order) or 1)


def test_block_rows_must_exceed_the_order(bearing: LinearBearing) -> None:
    record = bearing.experiment()
    with pytest.raises(IdentificationError, match="block_rows 6 is not allowed; allowed: 7 to 200 for order 6"):
        n4sid(record.current, record.position, record.sample_time, 6, block_rows=6)


def test_an_unknown_method_is_refused(bearing: LinearBearing) -> None:
    with pytest.raises(
        IdentificationError, match="unknown method 'magic'; allowed: pem, ssarx, pbsid, cva, n4sid, moesp"
    ):
        identify(bearing.experiment(), method="magic")


@pytest.mark.parametrize(("name", "kind"), [("current", "input"), ("position", "output")])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_samples_that_are_not_finite_are_refused_with_their_place(
    bearing: LinearBearing, name: str, kind: str, value: float
) -> None:
    record = bearing.experiment()
    samples = getattr(record, name).copy()
    samples[[700, 900], 1] = value
    record = replace(record, **{name: samples})
    with pytest.raises(IdentificationError, match=f"{kind} is not finite at sample 700: "):
        n4sid(record.current, record.position, record.sample_time)


@pytest.mark.parametrize(("name", "kind"), [("current", "input"), ("position", "output")])
@pytest.mark.parametrize("number", [1, 2])
def test_a_constant_signal_is_refused_with_its_number(
    bearing: LinearBearing, name: str, kind: str, number: int
) -> None:
    samples = getattr(bearing.experiment(), name).copy()
    samples[:, number - 1] = 1.5
    record = replace(bearing.experiment(), **{name: samples})
    with pytest.raises(IdentificationError, match=f"{kind} {number} is constant at 1.5"):
        n4sid(record.current, record.position, record.sample_time)


def test_arrays_that_are_not_columns_of_signals_are_refused(bearing: LinearBearing) -> None:
    record = bearing.experiment()
    with pytest.raises(IdentificationError, match="inputs of shape"):
        n4sid(record.current[:, 0], record.position[:, 0], record.sample_time)
    with pytest.raises(IdentificationError, match="inputs of shape"):
        n4sid(record.current[:0], record.position[:0], record.sample_time)


def test_parameters_and_dispatch_know_the_same_methods() -> None:
    assert get_args(Method) == tuple(METHODS)


@pytest.mark.parametrize(("method", "order"), [("n4sid", 2), ("pem", 2), *((method, 10) for method in METHODS)])
def test_degenerate_data_are_refused_in_one_line_or_give_a_finite_model(
    bearing: LinearBearing, method: str, order: int
) -> None:
    random = np.random.default_rng(0)
    record = bearing.experiment().window(0, 2_000)
    steps = record.steps
    ramp = np.column_stack([np.arange(steps), -np.arange(steps)]) * 1e-9
    impulse = np.zeros((steps, 2))
    impulse[100] = 1e-6
    tone = np.column_stack([np.sin(0.01 * np.arange(steps)), np.cos(0.02 * np.arange(steps))])
    collinear = record.current[:, [0, 0]]
    for current, position in [
        (collinear, record.position),
        (record.current, record.position[:, [0, 0]]),
        (record.current, record.current),
        (ramp, ramp),
        (impulse, impulse),
        (impulse, record.position),
        (tone, np.roll(tone, 3, axis=0)),
        (random.normal(size=(steps, 2)), random.normal(size=(steps, 2)) * 1e-6),
        (record.current * 1e-100, record.position),
        (record.current, record.position * 1e200),
    ]:
        try:
            result = identify(replace(record, current=current, position=position), order, method)
        except IdentificationError as refusal:
            assert "\n" not in str(refusal)
        else:
            assert not np.any(np.isnan(result.model.fit))


def test_inputs_that_cannot_be_told_apart_are_refused(bearing: LinearBearing) -> None:
    record = bearing.experiment()
    with pytest.raises(IdentificationError, match=r"not independent .* excite the inputs independently"):
        n4sid(record.current[:, [0, 0]], record.position, record.sample_time, 6)
