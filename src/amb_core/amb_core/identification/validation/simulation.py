"""The model in closed loop with the known controller, compared with the data: its only input is the reference.

As in the paper's Fig. 13 to 15, there are two simulations: the model of the deviations alone, which does not contain
the rest position of the rotor, and with the means of the identification data added to its inputs and outputs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import IdentificationError
from amb_core.identification.closed_loop import (
    DivergenceError,
    closed_loop_poles,
    simulate_closed_loop,
)
from amb_core.identification.controller_state import start_of
from amb_core.identification.fit import nrmse_fit
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.loop.known_controller import KnownController
from amb_core.loop.records import LoopRecord


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """The closed loop of model and controller, compared with the data.

    Attributes
    ----------
    poles : ndarray of complex, shape (n + c,)
        Poles in the z plane (-) of model and controller, largest magnitude first.
    measured : tuple of LoopRecord
        The experiments whose reference is known.
    simulated : tuple of LoopRecord or None
        The same, simulated from the reference alone; None where the simulation diverges.
    without_means : tuple of LoopRecord or None
        The same by the model of the deviations alone, without its offsets.
    fit : ndarray, shape (axes,)
        NRMSE fit of each position over all these experiments (percent); -inf where a simulation diverges.
    fit_without_means : ndarray, shape (axes,)
        The same without means (percent).
    offset : ndarray, shape (axes,)
        Mean of the measured minus that of the simulated position (m); NaN where a simulation diverges.
    """

    poles: NDArray[np.complex128]
    measured: tuple[LoopRecord, ...]
    simulated: tuple[LoopRecord | None, ...]
    without_means: tuple[LoopRecord | None, ...]
    fit: NDArray[np.float64]
    fit_without_means: NDArray[np.float64]
    offset: NDArray[np.float64]

    @property
    def stable(self) -> bool:
        """Whether all poles lie inside the unit circle."""
        return bool(np.all(np.abs(self.poles) < 1.0))


def check_closed_loop(
    model: StateSpaceModel,
    controller: KnownController,
    measured: Sequence[LoopRecord],
    first_states: NDArray[np.float64],
) -> ClosedLoop:
    """Simulate each record from its reference alone.

    Parameters
    ----------
    model, controller : StateSpaceModel, KnownController
        Of the loop.
    measured : sequence of LoopRecord
        The data; at least one.
    first_states : ndarray, shape (records, n)
        State of the model at the first sample of each.

    Raises
    ------
    IdentificationError
        If model and controller do not fit together, or a position does not move.
    """
    poles = closed_loop_poles(model, controller)
    none = {name: np.zeros_like(getattr(model, name)) for name in ("input_offset", "output_offset")}
    deviations = replace(model, **none)
    simulated = simulate_records(model, controller, measured, first_states)
    without_means = simulate_records(deviations, controller, measured, first_states)
    offset = np.full(len(model.c), np.nan)
    if all(record is not None for record in simulated):
        errors = [one.position - two.position for one, two in zip(measured, simulated, strict=True) if two is not None]
        offset = np.vstack(errors).mean(axis=0)
    return ClosedLoop(
        poles,
        tuple(measured),
        simulated,
        without_means,
        _fit(measured, simulated),
        _fit(measured, without_means),
        offset,
    )


def simulate_records(
    model: StateSpaceModel,
    controller: KnownController,
    measured: Sequence[LoopRecord],
    first_states: NDArray[np.float64],
) -> tuple[LoopRecord | None, ...]:
    """The closed loop under the reference of each record, from these states of the model; None where it diverges."""
    return tuple(
        _simulate(replace(model, initial_state=state), controller, record)
        for record, state in zip(measured, first_states, strict=True)
    )


def _simulate(model: StateSpaceModel, controller: KnownController, record: LoopRecord) -> LoopRecord | None:
    start = start_of(controller, record)
    try:
        return simulate_closed_loop(model, controller, record.reference, record.first_step, start)
    except DivergenceError:
        return None


def _fit(measured: Sequence[LoopRecord], simulated: Sequence[LoopRecord | None]) -> NDArray[np.float64]:
    followed = [record.position for record in simulated if record is not None]
    if len(followed) < len(measured):
        return np.full(measured[0].position.shape[1], -np.inf)
    try:
        return nrmse_fit(np.vstack([record.position for record in measured]), np.vstack(followed))
    except IdentificationError as problem:
        raise IdentificationError(f"closed loop: {problem}") from None
