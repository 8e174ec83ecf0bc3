"""One call from a record of the loop to a validated model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from amb_core.control import ControllerParameters
from amb_core.errors import IdentificationError
from amb_core.identification.closed_loop import DivergenceError, closed_loop_poles, simulate_closed_loop
from amb_core.identification.cva import cva
from amb_core.identification.model import StateSpaceModel
from amb_core.identification.pbsid import pbsid
from amb_core.identification.pem import pem
from amb_core.identification.ssarx import ssarx
from amb_core.identification.subspace import n4sid_horizons
from amb_core.identification.validation import nrmse_fit
from amb_core.records import LoopRecord


def _one(
    method: Callable[..., StateSpaceModel],
    inputs: NDArray[np.float64],
    outputs: NDArray[np.float64],
    sample_time: float,
    order: int,
    source: str,
) -> list[StateSpaceModel]:
    return [method(inputs, outputs, sample_time, order, source=source)]


def _pem(
    inputs: NDArray[np.float64], outputs: NDArray[np.float64], sample_time: float, order: int, source: str
) -> list[StateSpaceModel]:
    return [pem(inputs, outputs, ssarx(inputs, outputs, sample_time, order), source=source)]


Method = Literal["pem", "ssarx", "pbsid", "cva", "n4sid", "moesp"]
# A method answers with one or more models of the order asked for.
METHODS: dict[str, Callable[..., list[StateSpaceModel]]] = {
    "pem": _pem,
    "ssarx": partial(_one, ssarx),
    "pbsid": partial(_one, pbsid),
    "cva": partial(_one, cva),
    "n4sid": partial(n4sid_horizons, method="n4sid"),
    "moesp": partial(n4sid_horizons, method="moesp"),
}


@dataclass(frozen=True)
class Identification:
    """An identified model and what its validation shows.

    Attributes
    ----------
    model : StateSpaceModel
        The model, with `fit` filled in.
    record : LoopRecord
        The data.
    simulation : LoopRecord or None
        The model in closed loop with the known controller under the same reference; None where that diverges.
    closed_loop_poles : ndarray
        Poles in the z plane of model and controller, largest magnitude first.
    """

    model: StateSpaceModel
    record: LoopRecord
    simulation: LoopRecord | None
    closed_loop_poles: NDArray[np.complex128]

    @property
    def stable(self) -> bool:
        """Whether all closed-loop poles lie inside the unit circle."""
        return bool(np.all(np.abs(self.closed_loop_poles) < 1.0))

    @property
    def summary(self) -> str:
        """One line for people."""
        fit = ", ".join(
            f"{name} {value:.2f} %" for name, value in zip(self.model.output_names, self.model.fit, strict=True)
        )
        unstable = len(self.model.unstable_poles())
        return (
            f"{self.model.method}, order {self.model.order}, {self.model.samples} samples: closed-loop fit {fit}; "
            f"{unstable} unstable plant poles; closed loop {'stable' if self.stable else 'unstable'}"
        )


def identify(
    record: LoopRecord,
    order: int = 10,
    method: str = "pem",
    controller: ControllerParameters | None = None,
    source: str = "",
) -> Identification:
    """Identify the plant from control currents and positions, and validate it in closed loop on the same data.

    Where a method has several models to offer, the one is taken whose closed loop is stable and follows the worse of
    the two positions best.

    Parameters
    ----------
    record : LoopRecord
        Data of the closed loop.
    order : int
        Number of states.
    method : str
        One of `METHODS`; `pem` starts from `ssarx`.
    controller : ControllerParameters, optional
        The controller of the experiment; the paper's by default.
    source : str
        Where the data come from, kept in the model.

    Raises
    ------
    IdentificationError
        If the method is unknown, the order does not suit the data or the data determine no model.
    """
    if method not in METHODS:
        raise IdentificationError(f"unknown method {method!r}; allowed: {', '.join(METHODS)}")
    controller = controller or ControllerParameters()
    _check_finite(record)
    models = METHODS[method](record.current, record.position, record.sample_time, order, source=source)
    return max((_validate(model, record, controller) for model in models), key=_quality)


def _validate(model: StateSpaceModel, record: LoopRecord, controller: ControllerParameters) -> Identification:
    poles = closed_loop_poles(model, controller)
    # Data that start with the run start with the controller; in others its past shows in its first answer.
    first_current = record.current[0] if record.first_step > 0 else None
    try:
        simulation = simulate_closed_loop(model, controller, record.reference, record.first_step, first_current)
    except DivergenceError:
        return Identification(replace(model, fit=np.full(2, -np.inf)), record, None, poles)
    fit = nrmse_fit(record.position, simulation.position)
    return Identification(replace(model, fit=fit), record, simulation, poles)


def _quality(result: Identification) -> tuple[bool, float, float]:
    """Stability, the worse fit and, among models that diverge, the size of the one-step prediction errors.

    The data come from a bounded loop, so a model whose loop drifts away, however slowly, is the worse one.
    """
    size = float(np.linalg.det(result.model.innovation_covariance))
    return result.stable, float(np.min(result.model.fit)), -size


def _check_finite(record: LoopRecord) -> None:
    for name, samples in (("reference", record.reference), ("position", record.position), ("current", record.current)):
        finite = np.isfinite(samples).all(axis=1)
        if not finite.all():
            index = int(np.argmin(finite))
            raise IdentificationError(
                f"{name} is not finite at step {record.first_step + index}: {samples[index].tolist()}"
            )
