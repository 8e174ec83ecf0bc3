"""Data from bags: telemetry, or the topics of positions and control current references if it was not recorded.

Missing steps split the samples into experiments. Topics are found by message type, regardless of their names.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.data.analysis.recorded_clearance import recorded_clearance
from amb_core.data.experiments.dataset import IdentificationData
from amb_core.data.experiments.experiment import Experiment
from amb_core.ground.errors import BagError
from amb_core.loop.experiments import last_experiment, select_window
from amb_core.loop.records import axis_names
from amb_core.recording import Recording

POSITION = "amb_msgs/msg/RotorPosition"
CURRENT = "amb_msgs/msg/CurrentReference"
_TIME_TOLERANCE = 1e-3  # of a sample time, by which a stamp may differ from its step; stamps count in ns


def recorded_data(
    recording: Recording,
    run: int | None = None,
    first_step: int = -1,
    steps: int = 0,
    *,
    position_topic: str | None = None,
    current_topic: str | None = None,
) -> IdentificationData:
    """Inputs i_x, i_y ... (A) and outputs x, y ... (m) of one run of a recording.

    Parameters
    ----------
    recording : Recording
        Made by the recorder or by `ros2 bag record`.
    run : int, optional
        The run; by default the last one.
    first_step, steps : int, optional
        The requested steps, selected as by `select_window`: by default the last experiment, or all steps without an
        excitation.
    position_topic, current_topic : str, optional
        Topics of RotorPosition and CurrentReference, if there are several of them or telemetry is to be ignored. They
        do not contain the reference. By default telemetry, or else the only topics of these types.

    Returns
    -------
    IdentificationData
        One experiment; several with gaps between them where samples are missing.

    Raises
    ------
    BagError
        If the bag has neither telemetry nor both topics, or these do not belong together.
    IdentificationError
        If the requested steps are missing.
    """
    if position_topic is None and current_topic is None and recording.runs:
        data = _from_telemetry(recording, run, first_step, steps)
        return replace(data, clearance=recorded_clearance(recording, data.output_names, run))
    data = _from_topics(recording, position_topic, current_topic, run, first_step, steps)
    return replace(data, clearance=recorded_clearance(recording, data.output_names))


def _from_telemetry(recording: Recording, run: int | None, first_step: int, steps: int) -> IdentificationData:
    run = recording.runs[-1] if run is None else run
    spans = recording.spans(run)
    if not spans:
        raise BagError(f"bag {recording.path}: holds no run {run}; its runs: {', '.join(map(str, recording.runs))}")
    start, stop = _window(recording, run, spans, first_step, steps)
    source = f"{recording.path}, run {run}"
    records = [recording.telemetry(run, *span) for span in _within(spans, start, stop)]
    parts = [IdentificationData.from_record(record, source) for record in records]
    return replace(parts[0], experiments=tuple(item for part in parts for item in part.experiments))


def _from_topics(
    recording: Recording,
    position_topic: str | None,
    current_topic: str | None,
    run: int | None,
    first_step: int,
    steps: int,
) -> IdentificationData:
    position_topic = position_topic or _only_topic(recording, POSITION, "position_topic")
    current_topic = current_topic or _only_topic(recording, CURRENT, "current_topic")
    positions, currents = _by_run(recording, position_topic, POSITION), _by_run(recording, current_topic, CURRENT)
    where = f"bag {recording.path}: {position_topic} and {current_topic}"
    common = [number for number in positions if number in currents]
    if not common:
        raise BagError(
            f"{where} have no run in common ({_list(positions)} and {_list(currents)}); record both from the same loop"
        )
    run = common[-1] if run is None else run
    if run not in common:
        raise BagError(f"{where}: hold no run {run}; their runs: {_list(common)}")
    position_steps, timed = _in_order(positions[run], _timed_position, f"bag {recording.path}: {position_topic}")
    current_steps, current = _in_order(currents[run], _current, f"bag {recording.path}: {current_topic}")
    position, time = timed[:, 1:], timed[:, 0]
    if position.shape[1] != current.shape[1]:
        raise BagError(f"{where} differ in their axes: {position.shape[1]} positions, {current.shape[1]} currents")
    matched, of_position, of_current = np.intersect1d(position_steps, current_steps, True, True)
    if 2 * len(matched) <= max(len(position_steps), len(current_steps)):
        raise BagError(
            f"{where} do not belong together: of {len(position_steps)} positions (steps {_range(position_steps)}) and "
            f"{len(current_steps)} currents (steps {_range(current_steps)}) of run {run} only {len(matched)} have one "
            "step; record both topics over the same time, or telemetry instead"
        )
    sample_time = _sample_time(position_steps, time, f"bag {recording.path}: {position_topic}")
    edges = np.flatnonzero(np.diff(matched) > 1) + 1
    spans = [(int(part[0]), int(part[-1]) + 1) for part in np.split(matched, edges)]
    start, stop = _window(recording, run, spans, first_step, steps)
    inputs, outputs = current[of_current], position[of_position]
    experiments = []
    for span_start, span_stop in _within(spans, start, stop):
        part = slice(*np.searchsorted(matched, (span_start, span_stop)))
        experiments.append(
            Experiment(inputs[part], outputs[part], first_step=span_start, source=f"{recording.path}, run {run}")
        )
    axes = axis_names(outputs.shape[1])
    inputs_named = tuple(f"i_{axis}" for axis in axes)
    units = ("A",) * len(axes), ("m",) * len(axes)
    return IdentificationData(tuple(experiments), sample_time, inputs_named, axes, *units)


def _timed_position(message: Any) -> list[float]:
    """Time and positions of a RotorPosition message; in version 0.1 the axes are x and y."""
    axes = (message.x, message.y) if hasattr(message, "x") else message.position
    return [message.time, *axes]


def _current(message: Any) -> list[float]:
    """Currents of a CurrentReference message; in version 0.1 the axes are x and y."""
    return [message.i_x, message.i_y] if hasattr(message, "i_x") else list(message.current)


def _window(
    recording: Recording, run: int, spans: Sequence[tuple[int, int]], first_step: int, steps: int
) -> tuple[int, int]:
    """The requested steps; at least one of them must be available."""
    experiment = last_experiment(recording.excitations(run), run)
    start, stop = select_window((spans[0][0], spans[-1][1]), experiment, first_step, steps)
    beyond = 0 <= first_step < spans[0][0] or (steps and stop > spans[-1][1])
    if beyond or not _within(spans, start, stop):
        raise BagError(
            f"bag {recording.path}, run {run}: does not hold steps {start} to {stop - 1}; "
            f"it has steps {spans[0][0]} to {spans[-1][1] - 1}"
        )
    return start, stop


def _within(spans: Sequence[tuple[int, int]], start: int, stop: int) -> list[tuple[int, int]]:
    cut = [(max(first, start), min(last, stop)) for first, last in spans]
    return [(first, last) for first, last in cut if first < last]


def _only_topic(recording: Recording, message_type: str, argument: str) -> str:
    topics = [topic.name for topic in recording.topics if topic.type == message_type]
    if len(topics) == 1:
        return topics[0]
    if topics:
        raise BagError(
            f"bag {recording.path}: {message_type} is on more than one topic: {', '.join(topics)}; "
            f"name one as {argument}"
        )
    there = ", ".join(f"{topic.name} ({topic.type})" for topic in recording.topics) or "none"
    raise BagError(
        f"bag {recording.path}: holds neither telemetry (amb_msgs/msg/LoopSamples) nor {message_type}; "
        f"its topics: {there}"
    )


def _by_run(recording: Recording, topic: str, message_type: str) -> dict[int, list[Any]]:
    """Messages of a topic by run, the run recorded last at the end."""
    types = [known.type for known in recording.topics if known.name == topic]
    if types and types != [message_type]:
        raise BagError(f"bag {recording.path}: {topic} is of type {', '.join(types)}; {message_type} is needed")
    runs: dict[int, list[Any]] = {}
    for message in recording.messages_of(topic):
        runs.setdefault(int(message.run), []).append(message)
    return runs


def _in_order(
    messages: list[Any], content: Callable[[Any], list[float]], where: str
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Steps in order and without repetition, and the content of their messages, a row each."""
    steps = np.array([message.step for message in messages], dtype=np.int64)
    rows = [content(message) for message in messages]
    if len({len(row) for row in rows}) > 1:
        raise BagError(f"{where}: the number of axes changes from message to message")
    values = np.array(rows, dtype=np.float64)
    order = np.argsort(steps, kind="stable")
    steps, values = steps[order], values[order]
    repeated = np.flatnonzero(np.diff(steps) == 0)
    differing = [row for row in repeated if not np.array_equal(values[row], values[row + 1], equal_nan=True)]
    if differing:
        raise BagError(
            f"{where}: step {steps[differing[0]]} occurs twice with different values; are there two publishers?"
        )
    kept = np.concatenate([[True], np.diff(steps) > 0])
    return steps[kept], values[kept]


def _sample_time(steps: NDArray[np.int64], time: NDArray[np.float64], where: str) -> float:
    """Sample time (s) that is consistent with the times of all steps."""
    if len(steps) < 2:
        raise BagError(f"{where}: one message does not determine the sample time; at least two are needed")
    sample_time = float((time[-1] - time[0]) / (steps[-1] - steps[0]))
    if not sample_time > 0.0:
        raise BagError(f"{where}: times must rise with the steps; they go from {time[0]:g} s to {time[-1]:g} s")
    error = np.abs(time - time[0] - (steps - steps[0]) * sample_time)
    worst = int(np.argmax(error))
    if not error[worst] <= _TIME_TOLERANCE * sample_time + 1e-9:
        raise BagError(
            f"{where}: irregular sample time: step {steps[worst]} is {error[worst]:.3g} s off a sample time of "
            f"{sample_time:g} s; the controller must run at one rate throughout"
        )
    return float(f"{sample_time:.9g}")  # without the rounding of the time stamps


def _list(runs: Sequence[int] | dict[int, list[Any]]) -> str:
    return f"runs {', '.join(map(str, runs))}" if runs else "no runs"


def _range(steps: NDArray[np.int64]) -> str:
    return f"{steps[0]} to {steps[-1]}"
