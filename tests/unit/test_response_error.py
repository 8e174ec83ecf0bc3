"""The relative error of a frequency response, entry by entry."""

import numpy as np
import pytest

from amb_core.ground.errors import IdentificationError
from amb_core.identification.response_error import response_error
from amb_core.linear import LinearSystem
from amb_core.linear.model.state_space import StateSpaceModel

SAMPLE_TIME = 1e-4
POLES = np.array([0.9, 0.95, 0.99])


def system(gains: np.ndarray, inputs=("i_1", "i_2"), outputs=("a", "b", "c")) -> LinearSystem:
    """Three outputs, each a low-pass of a mixture of two inputs."""
    a, c = np.diag(POLES), np.diag(1.0 - POLES)
    return LinearSystem(a, gains, c, np.zeros((3, 2)), SAMPLE_TIME, inputs, outputs)


def model(gains: np.ndarray) -> StateSpaceModel:
    return StateSpaceModel(
        a=np.diag(POLES), b=gains, c=np.diag(1.0 - POLES), d=np.zeros((3, 2)), k=np.zeros((3, 3)),
        innovation_covariance=np.eye(3), input_offset=np.zeros(2), output_offset=np.zeros(3), initial_state=np.zeros(3),
        sample_time=SAMPLE_TIME, input_names=("i_1", "i_2"), output_names=("a", "b", "c"),
    )  # fmt: skip


GAINS = np.array([[1.0, 0.1], [0.5, 2.0], [0.001, 1.0]])


def test_an_error_of_one_entry_is_found_where_it_is():
    wrong = GAINS.copy()
    wrong[0, 1] *= 1.04
    error = response_error(model(wrong), system(GAINS))
    assert error.largest == pytest.approx(0.04, rel=1e-9)
    assert error.entries[0, 1] == pytest.approx(0.04, rel=1e-9)
    assert error.entries[1, 0] == pytest.approx(0.0, abs=1e-12)
    assert "from i_2 to a" in error.worst


def test_entries_that_are_small_at_a_frequency_do_not_count_there():
    wrong = GAINS.copy()
    wrong[2, 0] *= 3.0  # 0.05 % of the largest entry
    error = response_error(model(wrong), system(GAINS))
    assert error.largest < 1e-12
    assert np.isnan(error.entries[2, 0])
    assert response_error(model(wrong), system(GAINS), floor=0.0).largest == pytest.approx(2.0)


def test_the_floor_is_that_of_each_frequency():
    """The slow low-pass falls below 1 % of the others at high frequencies, and its error counts no more."""
    gains = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.05]])
    wrong = gains.copy()
    wrong[2, 1] *= 1.5
    error = response_error(model(wrong), system(gains))
    compared = np.isfinite(error.relative[:, 2, 1])
    assert compared[0]
    assert not compared[-1]
    assert error.largest == pytest.approx(0.5)


def test_the_band_is_kept_and_one_beyond_the_nyquist_frequency_refused():
    error = response_error(model(GAINS), system(GAINS), band=(20.0, 400.0), points=7)
    np.testing.assert_allclose(error.frequency[[0, -1]], [20.0, 400.0])
    with pytest.raises(IdentificationError, match="half the sample rate"):
        response_error(model(GAINS), system(GAINS), band=(5.0, 6_000.0))


@pytest.mark.parametrize(("inputs", "outputs"), [(("i_2", "i_1"), ("a", "b", "c")), (("i_1", "i_2"), ("b", "a", "c"))])
def test_the_same_names_in_another_order_are_refused(inputs, outputs):
    with pytest.raises(IdentificationError, match="the same number, in the same order"):
        response_error(model(GAINS), system(GAINS, inputs, outputs))


def test_other_names_of_the_same_number_are_compared():
    assert response_error(model(GAINS), system(GAINS, ("u1", "u2"), ("1", "2", "3"))).largest < 1e-12
