"""Identification from several experiments, each with a first state of its own."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import pytest

from amb_core.ground.errors import IdentificationError
from amb_core.identification import StateSpaceModel, cva, n4sid, pbsid, pem, ssarx
from amb_core.identification.estimate.predictor import fit_input_matrix, innovations

if TYPE_CHECKING:
    from conftest import LinearBearing

PARTS = ((0, 6_000), (7_012, 5_000), (13_333, 6_667))  # first step and steps; what lies between is missing


def experiments(bearing: LinearBearing) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Control currents and positions of three parts of one run, cut where the rotor moves."""
    record = bearing.experiment(noise=5e-8, force=0.3)
    parts = [record.window(*part) for part in PARTS]
    return [part.current for part in parts], [part.position for part in parts]


@pytest.mark.parametrize("method", [ssarx, pbsid, cva])
def test_subspace_methods_identify_from_several_experiments(
    bearing: LinearBearing, method: Callable[..., StateSpaceModel]
) -> None:
    model = method(*experiments(bearing), bearing.sample_time, 6)
    assert model.unstable_poles() == pytest.approx(bearing.model.unstable_poles(), abs=1e-3)
    assert model.samples == sum(steps for _, steps in PARTS)


def test_pem_gives_each_experiment_its_first_state(bearing: LinearBearing) -> None:
    inputs, outputs = experiments(bearing)
    model = pem(inputs, outputs, ssarx(inputs, outputs, bearing.sample_time, 6))
    assert model.unstable_poles() == pytest.approx(bearing.model.unstable_poles(), abs=1e-4)
    # Where two experiments were taken for one, the jump between them would be a large innovation.
    expected = bearing.innovation_covariance(noise=5e-8, force=0.3)
    assert np.sqrt(np.diag(model.innovation_covariance)) == pytest.approx(np.sqrt(np.diag(expected)), rel=0.03)


def test_a_list_of_one_experiment_is_that_experiment(bearing: LinearBearing) -> None:
    record = bearing.experiment(noise=5e-8, force=0.3).window(0, 4_000)
    one = ssarx(record.current, record.position, record.sample_time, 6)
    other = ssarx([record.current], [record.position], record.sample_time, 6)
    assert one.a.tobytes() == other.a.tobytes()
    assert one.b.tobytes() == other.b.tobytes()


def test_the_first_states_of_all_experiments_are_recovered() -> None:
    random = np.random.default_rng(3)
    a, b, c = np.array([[1.02, 0.1], [0.0, 0.5]]), random.normal(size=(2, 2)), np.eye(2)
    k = a - 0.3 * np.eye(2)  # predictor poles at 0.3
    firsts, lengths = np.array([[0.4, -0.2], [3.0, 1.0]]), (40, 25)
    inputs = random.normal(size=(sum(lengths), 2))
    outputs = -innovations(a, b, c, k, firsts, inputs, np.zeros_like(inputs), lengths)
    # With outputs fed back by K the prediction is another one; without K the data are those of F = A - K C.
    b_fitted, _, found_firsts = fit_input_matrix(a - k @ c, c, np.zeros((2, 2)), inputs, outputs, lengths)
    assert b_fitted == pytest.approx(b, abs=1e-12)
    assert found_firsts == pytest.approx(firsts, abs=1e-12)


def test_experiments_that_do_not_suit_are_refused(bearing: LinearBearing) -> None:
    inputs, outputs = experiments(bearing)
    with pytest.raises(
        IdentificationError, match=r"the same numbers of samples, not \(6000, 5000\) and \(6000, 6667\)"
    ):
        ssarx(inputs[:2], outputs[::2], bearing.sample_time, 6)
    with pytest.raises(
        IdentificationError, match="600 samples, each less 42 for the horizons, are too few for order 6"
    ):
        ssarx([part[:50] for part in inputs * 4], [part[:50] for part in outputs * 4], bearing.sample_time, 6)
    with pytest.raises(IdentificationError, match="n4sid takes one experiment"):
        n4sid(inputs, outputs, bearing.sample_time, 6)
    start = ssarx(inputs, outputs, bearing.sample_time, 6)
    with pytest.raises(IdentificationError, match="12 experiments are not allowed; allowed: up to 10"):
        pem(inputs * 4, outputs * 4, start)
