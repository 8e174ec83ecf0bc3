"""The methods of identification by name, and their models of a data set."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, Literal

from amb_core.data.experiments import IdentificationData
from amb_core.identification.estimate.cva import cva
from amb_core.identification.estimate.pbsid import pbsid
from amb_core.identification.estimate.pem import MOST_ITERATIONS, pem
from amb_core.identification.estimate.scaled_data import Samples
from amb_core.identification.estimate.ssarx import ssarx, ssarx_ridges
from amb_core.identification.estimate.subspace import n4sid_horizons
from amb_core.identification.progress import Watch
from amb_core.linear.model.state_space import StateSpaceModel

Method = Literal["pem", "ssarx", "pbsid", "cva", "n4sid", "moesp"]


def _subspace(
    method: Callable[..., StateSpaceModel],
    inputs: Samples,
    outputs: Samples,
    sample_time: float,
    order: int,
    watch: Watch,
    feedthrough: bool,
) -> list[StateSpaceModel]:
    watch.tell("subspace", 0, 1)
    model = method(inputs, outputs, sample_time, order, feedthrough=feedthrough)
    watch.tell("subspace", 1, 1)
    return [model]


def _pem(
    inputs: Samples, outputs: Samples, sample_time: float, order: int, watch: Watch, feedthrough: bool
) -> list[StateSpaceModel]:
    (start,) = _subspace(ssarx, inputs, outputs, sample_time, order, watch, feedthrough)

    def tell(iteration: int, cost: float) -> None:
        searches = 1 if iteration <= MOST_ITERATIONS else 2
        watch.tell("pem", iteration, searches * MOST_ITERATIONS, cost)

    return [pem(inputs, outputs, start, tell, ended=watch.note_end, second_start=True, feedthrough=feedthrough)]


def _horizons(
    method: Literal["n4sid", "moesp"],
    inputs: Any,
    outputs: Any,
    sample_time: float,
    order: int,
    watch: Watch,
    feedthrough: bool,
) -> list[StateSpaceModel]:
    watch.tell("subspace", 0, 1)
    models = n4sid_horizons(inputs, outputs, sample_time, order, method=method, feedthrough=feedthrough)
    watch.tell("subspace", 1, 1)
    return models


METHODS: dict[str, Callable[[Samples, Samples, float, int, Watch, bool], list[StateSpaceModel]]] = {
    "pem": _pem,
    "ssarx": partial(_subspace, ssarx),
    "pbsid": partial(_subspace, pbsid),
    "cva": partial(_subspace, cva),
    "n4sid": partial(_horizons, "n4sid"),
    "moesp": partial(_horizons, "moesp"),
}


def estimate(
    data: IdentificationData, order: int, method: str, watch: Watch, source: str, feedthrough: bool = False
) -> list[StateSpaceModel]:
    """The model or models of a method, with the names of the data and about their operating point.

    Parameters
    ----------
    data : IdentificationData
        Data that the checks have passed.
    order : int
        Number of states.
    method : str
        One of `METHODS`.
    watch : Watch
        Receives the progress.
    source : str
        Where the data come from, kept in the models.
    feedthrough : bool
        Whether outputs respond within the sample.

    Raises
    ------
    IdentificationError
        If order or data do not suit the method, or the data determine no model.
    """
    inputs, outputs = _samples(data)
    return _of_data(METHODS[method](inputs, outputs, data.sample_time, order, watch, feedthrough), data, source)


def starts_for_simulation(
    data: IdentificationData, order: int, watch: Watch, source: str, feedthrough: bool = False
) -> list[StateSpaceModel]:
    """Models among which the simulated loop is to choose, as `estimate` returns them; there may be none.

    Parameters and errors are those of `estimate`.
    """
    watch.tell("subspace", 0, 1)
    models = ssarx_ridges(*_samples(data), data.sample_time, order, feedthrough)
    watch.tell("subspace", 1, 1)
    return _of_data(models, data, source)


def _samples(data: IdentificationData) -> tuple[Samples, Samples]:
    inputs = [item.inputs for item in data.experiments]
    outputs = [item.outputs for item in data.experiments]
    # n4sid and moesp take one array only
    return (inputs[0], outputs[0]) if len(data.experiments) == 1 else (inputs, outputs)


def _of_data(models: list[StateSpaceModel], data: IdentificationData, source: str) -> list[StateSpaceModel]:
    """The models with the names of the data and about their operating point."""
    return [
        replace(
            model,
            input_offset=model.input_offset + data.input_offset,
            output_offset=model.output_offset + data.output_offset,
            input_names=data.input_names,
            output_names=data.output_names,
            input_units=data.input_units,
            output_units=data.output_units,
            source=source,
        )
        for model in models
    ]
