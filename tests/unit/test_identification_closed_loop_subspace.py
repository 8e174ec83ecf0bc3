"""SSARX and PBSID on a known unstable bearing in closed loop: what they find under noise, and what they refuse."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import pytest

from amb_core.ground.errors import IdentificationError
from amb_core.identification import StateSpaceModel, cva, identify, pbsid, ssarx
from amb_core.loop.control import ControllerParameters

if TYPE_CHECKING:
    from conftest import LinearBearing

BASE_NOISE = {"noise": 5e-8, "force": 0.3}  # m, N
TENFOLD_NOISE = {"noise": 5e-7, "force": 3.0}
BAND = {"kind": "multisine", "amplitude": 20e-6, "frequency_start": 1.0, "frequency_end": 2_000.0}


LINEAR_LOOP = ControllerParameters(current_limit=100.0)  # a limit would be reached, and widen the band of the currents


@pytest.mark.parametrize("method", ["ssarx", "pbsid"])
@pytest.mark.parametrize("excitation", [{}, BAND], ids=["square", "multisine"])
@pytest.mark.parametrize("order", [7, 10])
def test_the_unstable_poles_are_found_and_the_closed_loop_is_stable(
    bearing: LinearBearing, method: str, excitation: dict[str, object], order: int
) -> None:
    result = identify(bearing.experiment(**BASE_NOISE, **excitation), order, method)
    assert result.model.unstable_poles() == pytest.approx(bearing.model.unstable_poles(), abs=1e-4)
    assert result.stable


@pytest.mark.parametrize("method", ["ssarx", "pbsid"])
def test_the_fit_reaches_what_the_noise_leaves_on_squares(bearing: LinearBearing, method: str) -> None:
    assert np.all(identify(bearing.experiment(**BASE_NOISE), 10, method).model.fit > 99.8)


@pytest.mark.parametrize("method", [ssarx, pbsid])
def test_a_ridge_is_found_for_band_limited_data(bearing: LinearBearing, method: Callable[..., StateSpaceModel]) -> None:
    record = bearing.experiment(**BASE_NOISE, **BAND, controller=LINEAR_LOOP)
    model = method(record.current, record.position, record.sample_time, 10)
    assert model.unstable_poles() == pytest.approx(bearing.model.unstable_poles(), abs=1e-3)
    assert bearing.response_error(model) < 0.06


def test_feedback_biases_cva(bearing: LinearBearing) -> None:
    record = bearing.experiment(**BASE_NOISE, **BAND, controller=LINEAR_LOOP)
    ours, theirs = (
        bearing.response_error(method(record.current, record.position, record.sample_time, 10))
        for method in (ssarx, cva)
    )
    assert ours < 0.2 * theirs


@pytest.mark.parametrize("method", ["ssarx", "pbsid"])
def test_feedback_does_not_bias_it_as_it_does_n4sid(bearing: LinearBearing, method: str) -> None:
    record = bearing.experiment(**TENFOLD_NOISE)
    ours, theirs = (identify(record, 10, name).model for name in (method, "n4sid"))
    assert ours.unstable_poles() == pytest.approx(bearing.model.unstable_poles(), abs=1e-3)
    assert np.all(ours.fit > theirs.fit + 3.0)
    assert bearing.response_error(ours) < 0.1 * bearing.response_error(theirs)


def test_the_innovations_of_the_model_are_those_of_the_kalman_filter(bearing: LinearBearing) -> None:
    model = identify(bearing.experiment(**BASE_NOISE), 10, "ssarx").model
    expected = bearing.innovation_covariance(**BASE_NOISE)
    assert np.sqrt(np.diag(model.innovation_covariance)) == pytest.approx(np.sqrt(np.diag(expected)), rel=0.02)
    assert np.max(np.abs(np.linalg.eigvals(model.a - model.k @ model.c))) < 1.0


def test_the_model_keeps_operating_point_and_provenance(bearing: LinearBearing) -> None:
    record = bearing.experiment()
    model = ssarx(record.current, record.position, record.sample_time, 6, source="bags/square")
    assert model.input_offset == pytest.approx(record.current.mean(axis=0))
    assert model.output_offset == pytest.approx(record.position.mean(axis=0))
    assert (model.method, model.source, model.samples) == ("ssarx", "bags/square", record.steps)
    assert not model.d.any()


def test_given_horizons_are_used(bearing: LinearBearing) -> None:
    record = bearing.experiment(**BASE_NOISE)
    model = ssarx(record.current, record.position, record.sample_time, 6, past=20, future=8)
    assert model.unstable_poles() == pytest.approx(bearing.model.unstable_poles(), abs=1e-3)


def test_short_data_are_enough_for_a_short_past(bearing: LinearBearing) -> None:
    record = bearing.experiment(**BASE_NOISE).window(0, 2_000)
    model = ssarx(record.current, record.position, record.sample_time, 6)
    assert len(model.unstable_poles()) >= 1
    assert model.samples == 2_000


@pytest.mark.parametrize("method", [ssarx, pbsid, cva])
@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"order": 0}, "order 0 is not allowed; allowed: 1 to 40"),
        ({"order": 41}, "order 41 is not allowed"),
        ({"order": 10, "past": 5}, "past 5 is not allowed; allowed: at least 6 for order 10"),
        ({"order": 10, "future": 0}, "future 0 is not allowed; allowed: at least 6 for order 10"),
        ({"order": 10, "past": 5_000}, "20000 samples are too few for order 10; at least 25105 are needed"),
    ],
)
def test_order_and_horizons_that_do_not_suit_are_refused(
    bearing: LinearBearing, method: Callable[..., StateSpaceModel], settings: dict[str, int], reason: str
) -> None:
    record = bearing.experiment()
    with pytest.raises(IdentificationError, match=reason):
        method(record.current, record.position, record.sample_time, **settings)


def test_too_few_samples_are_refused(bearing: LinearBearing) -> None:
    record = bearing.experiment()
    with pytest.raises(IdentificationError, match="100 samples are too few for order 10"):
        ssarx(record.current[:100], record.position[:100], record.sample_time, 10)


def test_data_that_determine_no_model_are_refused(bearing: LinearBearing) -> None:
    record = bearing.experiment()
    still = record.current * [1.0, 0.0]
    broken = record.position.copy()
    broken[7, 1] = np.nan
    for inputs, outputs, reason in (
        (still, record.position, "input 2 is constant"),
        (record.current, broken, "output is not finite at sample 7"),
        (record.current[:, [0, 0]], record.position, "not independent"),
    ):
        with pytest.raises(IdentificationError, match=reason):
            ssarx(inputs, outputs, record.sample_time, 6)


@pytest.mark.parametrize("method", [ssarx, pbsid, cva])
def test_the_same_data_give_the_same_model_bit_for_bit(
    bearing: LinearBearing, method: Callable[..., StateSpaceModel]
) -> None:
    record = bearing.experiment().window(0, 4_000)
    one, other = (method(record.current, record.position, record.sample_time, 10) for _ in range(2))
    for name in ("a", "b", "c", "k", "initial_state"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes()
