"""The runs of a bag in a few numbers, read message after message: of an hour in no more memory than of a second."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from amb_core.ground.errors import BagError
from amb_core.ground.given_values import path_of
from amb_core.loop.experiments import AppliedExcitation
from amb_core.recording.bag_reader import CONTROLLER, BagApart, kind_of
from amb_core.recording.messages.excitation_status import EXCITATION_STATUS, answer_from_message
from amb_core.recording.messages.loop_samples import LOOP_SAMPLES, block_from_message
from amb_core.recording.messages.state_space_model import STATE_SPACE_MODEL, model_from_message
from amb_core.recording.step_audit import StepAudit

if TYPE_CHECKING:
    from amb_core.linear.model import StateSpaceModel


@dataclass
class RunOverview:
    """A run with telemetry.

    Attributes
    ----------
    run : int
        Its number.
    sample_time : float
        Controller sample time (s).
    audit : StepAudit
        Its steps, and which are missing.
    excitations : list of AppliedExcitation
        The answers to all requests, refused ones too.
    """

    run: int
    sample_time: float
    audit: StepAudit = field(default_factory=StepAudit)
    excitations: list[AppliedExcitation] = field(default_factory=list)


def read_runs(path: str | Path) -> tuple[list[RunOverview], StateSpaceModel | None]:
    """The runs of a bag, and the last model that was identified while recording.

    Parameters
    ----------
    path : str or Path
        Folder or file of the bag, also of an incomplete one.

    Returns
    -------
    runs : list of RunOverview
        The runs with telemetry, the one recorded last at the end.
    model : StateSpaceModel or None
        The model; None without one.

    Raises
    ------
    BagError
        If there is no bag, or a message cannot be decoded.
    """
    runs: dict[int, RunOverview] = {}
    answers: list[AppliedExcitation] = []
    model: Any = None
    for message in BagApart(path_of("path", path, BagError)).messages(
        types=[LOOP_SAMPLES, EXCITATION_STATUS, STATE_SPACE_MODEL]
    ):
        content = message.content
        if message.type == EXCITATION_STATUS:
            answers.append(answer_from_message(content))
        elif message.type == LOOP_SAMPLES:
            block, number = block_from_message(content), int(content.run)
            run = runs.pop(number) if number in runs else RunOverview(number, block.sample_time)
            runs[number] = run  # the last one that was written is the last
            run.audit.add(block.first_step, block.steps)
        elif kind_of(message.topic, message.type) != CONTROLLER:
            model = content
    for answer in answers:
        if answer.run in runs:
            runs[answer.run].excitations.append(answer)
    return list(runs.values()), None if model is None else model_from_message(model)
