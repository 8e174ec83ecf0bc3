"""Experiments: which steps of a run were excited, with which controller, and the samples of the loop."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from amb_core.ground.errors import IdentificationError
from amb_core.ground.parameters import part_of
from amb_core.loop.records import LoopRecord
from amb_core.loop.telemetry import merge_blocks

if TYPE_CHECKING:
    from amb_core.linear.model import StateSpaceModel
    from amb_core.loop.known_controller import KnownController, LinearControl
    from amb_core.loop.pd_parameters import ControllerParameters


@dataclass(frozen=True)
class AppliedExcitation:
    """An excitation and the controller's response to it.

    Attributes
    ----------
    run, id : int
        Run for which it was requested; its number among the excitations of its generator.
    kind : str
        Kind of excitation; `stop` for one that ends another, or with the number of one that has ended early.
    accepted : bool
        Whether the controller applied it; if not, `message` is the reason.
    first_step, steps : int
        Steps to which it was applied; `steps` is 0 for a stop.
    """

    run: int
    id: int
    kind: str
    accepted: bool
    message: str
    first_step: int
    steps: int

    @property
    def stop(self) -> int:
        """Step after its last one."""
        return self.first_step + self.steps


def last_experiment(excitations: Iterable[AppliedExcitation], run: int) -> tuple[int, int] | None:
    """First step of the last excitation of a run and the step after its last one; None if there was no excitation.

    A stop ends an excitation early.
    """
    window = None
    for excitation in excitations:
        if excitation.run != run or not excitation.accepted:
            continue
        if excitation.steps:
            window = (excitation.first_step, excitation.stop)
        elif window is not None:
            window = (window[0], max(window[0], min(window[1], excitation.first_step)))
    return window


def select_window(
    available: tuple[int, int], experiment: tuple[int, int] | None, first_step: int = -1, steps: int = 0
) -> tuple[int, int]:
    """The steps used for identification, as first step and the step after the last.

    Parameters
    ----------
    available : tuple of int
        First step of the data, and the step after their last.
    experiment : tuple of int or None
        From `last_experiment`.
    first_step : int, optional
        Requested first step; -1 for the start of the experiment, or of the data if there is no experiment.
    steps : int, optional
        Requested number of steps; 0 for all to the end of the experiment, or of the data if these end earlier.

    Raises
    ------
    IdentificationError
        If a number is out of range or no step is left.
    """
    if first_step < -1 or steps < 0:
        raise IdentificationError(
            f"first_step = {first_step}, steps = {steps} is not allowed; first_step must be -1 or more, steps 0 or more"
        )
    start = first_step if first_step >= 0 else experiment[0] if experiment else available[0]
    stop = available[1]
    if experiment and experiment[0] <= start < experiment[1]:
        stop = min(stop, experiment[1])
    if steps:
        stop = start + steps
    if stop <= start:
        raise IdentificationError(
            f"no samples from step {start} onwards; there are steps {available[0]} to {available[1] - 1}"
        )
    return start, stop


def controller_of(values: Mapping[str, object], sample_rate: float | None) -> ControllerParameters:
    """The control law's parameters among all of the node that runs it, at a sample rate (Hz) if one is known.

    Raises
    ------
    ParameterError
        If one of them is out of its range.
    """
    # This loads a compiler, which a recorder does not need.
    from amb_core.loop.control import ControllerParameters, with_present_names

    known = {} if sample_rate is None else {"sample_rate": sample_rate}
    return part_of(ControllerParameters, {**with_present_names(values), **known})


def controller_of_bridge(values: Mapping[str, object], sample_rate: float | None) -> KnownController:
    """The law that a `hardware_bridge` with these parameters has sent to its target; parameters as of `controller_of`.

    Raises
    ------
    ParameterError
        If a parameter is out of its range, or the file of a state-space controller cannot be read.
    """
    from amb_core.loop.known_controller import LinearControl  # loads a compiler
    from amb_core.loop.linear_parameters import LinearControllerParameters

    if not values.get("controller_file"):
        return controller_of(values, sample_rate)
    return LinearControl.load(str(values["controller_file"]), part_of(LinearControllerParameters, values))


def linear_controller_of(values: Mapping[str, object], published: StateSpaceModel | None) -> LinearControl | None:
    """The law of a `state_space_controller` with these parameters: the last one published, or that of its file.

    None if there is neither.

    Raises
    ------
    ParameterError
        If a parameter is out of its range, or the file cannot be read.
    """
    from amb_core.loop.known_controller import ControllerFileParameters, LinearControl  # loads a compiler
    from amb_core.loop.linear_parameters import LinearControllerParameters

    settings = part_of(ControllerFileParameters, values)
    parameters = part_of(LinearControllerParameters, values)
    if published is not None:
        return LinearControl(published, parameters)
    return LinearControl.load(settings.controller_file, parameters) if settings.controller_file else None


KEPT_EXCITATIONS = 1_000


class ExperimentBuffer:
    """The latest samples and excitations of the current run, from telemetry; safe for several threads.

    Parameters
    ----------
    capacity : int
        Number of steps kept, and of blocks, which may be empty; the oldest are dropped.
    """

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._lock = threading.Lock()
        self._blocks: deque[LoopRecord] = deque()
        self._excitations: dict[AppliedExcitation, None] = {}  # in the order of the answers
        self._run: int | None = None
        self._steps = 0

    @property
    def run(self) -> int | None:
        """The current run, None before the first telemetry."""
        return self._run

    @property
    def available(self) -> tuple[int, int]:
        """First step known, and the step after the last; both 0 before the first telemetry."""
        with self._lock:
            if not self._blocks:
                return 0, 0
            return self._blocks[0].first_step, self._blocks[-1].first_step + self._blocks[-1].steps

    @property
    def experiment(self) -> tuple[int, int] | None:
        """The last experiment of the current run, see `last_experiment`."""
        with self._lock:
            return None if self._run is None else last_experiment(self._excitations, self._run)

    def add_block(self, run: int, block: LoopRecord) -> None:
        """Add a block; one of another run, or from before the last block, clears the old data."""
        with self._lock:
            if run != self._run or (self._blocks and block.first_step <= self._blocks[-1].first_step):
                self._blocks.clear()
                self._steps = 0
                self._run = run
                self._excitations = {known: None for known in self._excitations if known.run >= run}
            self._blocks.append(block)
            self._steps += block.steps
            while self._steps - self._blocks[0].steps >= self._capacity or len(self._blocks) > self._capacity:
                self._steps -= self._blocks.popleft().steps

    def add_excitation(self, excitation: AppliedExcitation) -> None:
        """Add an excitation with the controller's response."""
        with self._lock:
            self._excitations.pop(excitation, None)  # reported again: it becomes the last one
            self._excitations[excitation] = None
            if len(self._excitations) > KEPT_EXCITATIONS:
                del self._excitations[next(iter(self._excitations))]

    def record(self, first_step: int, stop: int) -> LoopRecord:
        """The samples of these steps.

        Raises
        ------
        IdentificationError
            If some of them are missing.
        """
        with self._lock:
            blocks = list(self._blocks)
        return merge_blocks(blocks, first_step, stop, error=IdentificationError)
