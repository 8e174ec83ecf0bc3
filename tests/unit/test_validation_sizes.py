"""Validation, figures and files of models of m inputs and p outputs, from open-loop data."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
import pytest

from amb_core.data.experiments import check_data, write_data
from amb_core.ground.errors import IdentificationError
from amb_core.identification import IdentificationData, identify, response_of, validate
from amb_core.identification.nonparametric import estimate_response
from amb_core.identification.validation import predict
from amb_core.report.figures import bode_chart
from tests.linear_process import SIZES, LinearProcess


@functools.cache
def process_of(size: tuple[int, int]) -> LinearProcess:
    return LinearProcess(*size)


@functools.cache
def data_of(size: tuple[int, int], seed: int = 1) -> IdentificationData:
    return process_of(size).data(8_000, seed)


@functools.cache
def model_of(size: tuple[int, int]):
    return identify(data_of(size), 6, "ssarx").model


@pytest.mark.parametrize("size", SIZES)
def test_a_model_is_validated_on_other_data_on_a_page(size: tuple[int, int]) -> None:
    # Seed 2 is one of the hundred in which the check of feedback has a false alarm for one input and output.
    validation = validate(model_of(size), data_of(size, 3), horizons=(1, 4))
    assert validation.verdict == "validated with reservations", validation.summary
    assert {one.key for one in validation.failed} == {"closed_loop", "controller", "closed_loop_fit", "distortion"}, (
        "there is no loop"
    )
    assert validation.residuals.cross_correlation.shape == (51, size[1], size[0])
    page = validation.report().splitlines()
    assert max(map(len, page)) <= 100
    assert all(any(name in line.split() for line in page) for name in model_of(size).output_names)
    bands = validation.frequency.bands
    assert bands and np.median([band.difference for band in bands]) < 12.0
    assert "FREQUENCY    from the inputs, without a model: smoothed" in validation.report()


@pytest.mark.parametrize("size", SIZES)
def test_the_response_is_estimated_from_the_inputs_of_an_open_loop(size: tuple[int, int]) -> None:
    estimate = estimate_response(data_of(size), open_loop=True)
    assert estimate.response.response.shape[1:] == size[::-1]
    true = response_of(process_of(size).model, estimate.response.frequency).response
    ratio = np.abs(estimate.response.response - true) ** 2 / estimate.variance
    assert 0.6 < np.median(ratio) / estimate.largest_error(0.5) < 2.0


def test_a_periodic_input_is_averaged_over_its_periods() -> None:
    data = process_of((1, 2)).data(8_000, period=500)
    estimate = estimate_response(data, open_loop=True)
    assert estimate.response.label == "average of 15 periods of 250 s"  # the first one is not settled
    true = response_of(process_of((1, 2)).model, estimate.response.frequency).response
    assert np.linalg.norm(estimate.response.response - true) < 0.05 * np.linalg.norm(true)


def test_inputs_that_are_not_independent_are_refused() -> None:
    item = data_of((2, 1)).experiments[0]
    same = IdentificationData.from_arrays(np.repeat(item.inputs[:, :1], 2, axis=1), item.outputs, 0.5)
    with pytest.raises(IdentificationError, match="the inputs are not independent"):
        estimate_response(same, open_loop=True)


def test_without_a_reference_nothing_is_estimated_unless_the_loop_is_open() -> None:
    with pytest.raises(IdentificationError, match="the data have no reference"):
        estimate_response(data_of((1, 1)))


def test_fewer_references_than_inputs_are_refused() -> None:
    item = data_of((3, 2)).experiments[0]
    reference = np.random.default_rng(1).normal(size=item.outputs.shape)
    data = IdentificationData.from_arrays(item.inputs, item.outputs, 0.5, reference=reference)
    with pytest.raises(IdentificationError, match=r"3 inputs need as many references, there are 2$"):
        estimate_response(data)


def test_more_references_than_inputs_give_the_response_too() -> None:
    """One input, driven by the sum of two references through a controller; the process in a closed loop."""
    process, random = process_of((1, 2)), np.random.default_rng(4)
    model, steps = process.model, 20_000
    reference, errors = random.normal(size=(steps, 2)), 0.1 * random.normal(size=(steps, 2))
    inputs, outputs, state = np.empty((steps, 1)), np.empty((steps, 2)), np.zeros(6)
    for step in range(steps):
        outputs[step] = model.c @ state + errors[step]
        inputs[step] = 0.02 * np.sum(reference[step] - outputs[step])
        state = model.a @ state + model.b @ inputs[step]
    data = IdentificationData.from_arrays(inputs, outputs, 0.5, reference=reference)
    estimate = estimate_response(data)
    true = response_of(model, estimate.response.frequency).response
    ratio = np.abs(estimate.response.response - true) ** 2 / estimate.variance
    assert 0.6 < np.median(ratio) / estimate.largest_error(0.5) < 2.0


@pytest.mark.parametrize("size", SIZES)
def test_a_bode_diagram_has_a_panel_for_every_entry(size: tuple[int, int]) -> None:
    chart = bode_chart([response_of(model_of(size), np.geomspace(0.01, 0.9, 50))])
    assert chart.columns == size[0] and len(chart.panels) == 2 * size[0] * size[1]


@pytest.mark.parametrize("ending", ["csv", "mat", "npz"])
def test_files_keep_any_size_bit_for_bit(tmp_path: Path, ending: str) -> None:
    from amb_core.data.analysis import read

    data = data_of((3, 2))
    write_data(data, tmp_path / f"data.{ending}")
    table = read(tmp_path / f"data.{ending}").data
    assert (table.experiments[0].inputs == data.experiments[0].inputs).all()
    assert (table.experiments[0].outputs == data.experiments[0].outputs).all()
    assert table.input_names == data.input_names and table.output_units == data.output_units


@pytest.mark.parametrize("size", SIZES)
def test_the_checks_accept_good_data_of_every_size(size: tuple[int, int]) -> None:
    report = check_data(data_of(size), 6)
    assert not report.warnings and not report.errors


def test_data_of_other_counts_than_the_models_are_refused() -> None:
    with pytest.raises(IdentificationError, match=r"^the data have 1 inputs and 1 outputs, the model 3 and 2$"):
        predict(model_of((3, 2)), data_of((1, 1)))
