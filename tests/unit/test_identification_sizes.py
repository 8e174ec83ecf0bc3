"""Identification of m inputs and p outputs from open-loop data: every method, every size, and high orders."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from amb_core.ground.errors import IdentificationError
from amb_core.identification import METHODS, IdentificationData, identify, pem, select_order, ssarx
from amb_core.identification.estimate.arx import arx
from amb_core.identification.estimate.methods import estimate
from amb_core.identification.progress import Watch
from tests.linear_process import SIZES, LinearProcess


@functools.cache
def data_of(size: tuple[int, int], feedthrough: bool = False) -> IdentificationData:
    return LinearProcess(*size, feedthrough=feedthrough).data()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("size", SIZES)
def test_every_method_identifies_every_size(size: tuple[int, int], method: str) -> None:
    models = estimate(data_of(size), 6, method, Watch(), "process")
    # N4SID and MOESP estimate from several horizons; the best one counts.
    assert min(map(LinearProcess(*size).response_error, models)) < 0.04
    assert all(not model.d.any() for model in models)


@pytest.mark.parametrize("size", SIZES)
def test_names_units_and_operating_point_are_those_of_the_data(size: tuple[int, int]) -> None:
    model = identify(data_of(size), 6, "ssarx").model
    assert model.input_names == data_of(size).input_names and model.output_units == data_of(size).output_units
    assert model.input_offset == pytest.approx([3.0] * size[0], abs=0.1)
    assert model.output_offset == pytest.approx([-2.0] * size[1], abs=0.5)


def test_a_long_autoregressive_model_has_as_many_states_as_lags_times_outputs() -> None:
    item = data_of((3, 2)).experiments[0]
    model = arx(item.inputs, item.outputs, 0.5, 20)
    assert model.order == 40
    assert LinearProcess(3, 2).response_error(model) < 0.15


@pytest.mark.parametrize("size", [(1, 1), (4, 4)])
def test_the_order_is_found(size: tuple[int, int]) -> None:
    assert select_order(data_of(size), range(4, 9)).chosen == 6


def test_a_model_of_arrays_alone_numbers_its_signals() -> None:
    item = data_of((3, 2)).experiments[0]
    model = ssarx(item.inputs, item.outputs, 0.5, 6)
    assert (model.input_names, model.output_names) == (("u1", "u2", "u3"), ("y1", "y2"))
    assert model.input_units == ("", "", "") and model.output_units == ("", "")


def test_forty_states_of_one_axis_are_identified() -> None:
    process = LinearProcess(1, 1, 40, noise=0.001)
    assert process.response_error(identify(process.data(), 40, "ssarx").model) < 0.01


@pytest.mark.slow
def test_forty_states_of_four_axes_are_identified() -> None:
    process = LinearProcess(4, 4, 40)
    assert process.response_error(identify(process.data(10_000), 40).model) < 0.05


def test_wrong_counts_are_refused_in_one_line() -> None:
    random = np.random.default_rng(0)
    three, two = random.normal(size=(500, 3)), random.normal(size=(500, 2))
    for inputs, outputs, message in (
        (three[:, 0], two, r"^inputs of shape \(500,\) are not allowed; allowed: \(steps, signals\), one column for "),
        (three[:, :0], two, r"^inputs of shape \(500, 0\) are not allowed"),
        (three, two[:400], r"^inputs and outputs must have the same numbers of samples, not \(500,\) and \(400,\)$"),
        ([three, two], [two, two], r"^experiments with 3 and 2 inputs cannot be joined; all need the same inputs$"),
        ([], [], r"^there are no inputs; at least one experiment is needed$"),
    ):
        with pytest.raises(IdentificationError, match=message):
            ssarx(inputs, outputs, 0.5, 2)
    start = ssarx(three, two, 0.5, 2)
    with pytest.raises(IdentificationError, match=r"^the start has 3 inputs and 2 outputs, the data 2 and 2$"):
        pem(two, two + random.normal(size=two.shape), start)


def test_too_few_samples_name_what_this_size_needs() -> None:
    with pytest.raises(IdentificationError, match=r"60 samples are too few for order 6"):
        identify(data_of((4, 4)).window(0, 60), 6, "n4sid")
