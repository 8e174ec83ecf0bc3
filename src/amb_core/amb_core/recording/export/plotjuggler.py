"""A run for PlotJuggler: a bag of standard ROS 2 messages, one per sample, for which it needs no message packages.

PlotJuggler shows joint states by joint. So the axes are joints: `/amb/loop/x/position` is the position (m) and
`/amb/loop/x/effort` the control current (A), `/amb/reference/x/position` the reference (m). What a topic does not
have is NaN: PlotJuggler before 2024 reads beyond the end of an empty array (its pull request 927). Numbers without a
header have the time of the sample as the time of the message.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from amb_core.loop.records import LoopRecord
from amb_core.recording.content import REGION_STATE
from amb_core.recording.export.columns import chosen_signals
from amb_core.recording.export.message_rows import MessageRows
from amb_core.recording.export.message_types import MessageTypes
from amb_core.recording.export.run_telemetry import RunTelemetry
from amb_core.recording.export.sample_file import SampleFile
from amb_core.recording.export.spectra import RunSpectra
from amb_core.recording.export.status import MODES, state_messages

OTHERS = ("region", "status", "spectrum")
JOINTS, NUMBER = "sensor_msgs/msg/JointState", "std_msgs/msg/Float64"
COUNT, SMALL = "std_msgs/msg/UInt64", "std_msgs/msg/UInt8"
LOOP, REFERENCE = "/amb/loop", "/amb/reference"
MISSING, MODE = "/amb/status/missing", "/amb/status/mode"
SPECTRUM, FREQUENCY = "/amb/spectrum", "/amb/spectrum/frequency"
REGION, EVIDENCE_TOPIC = "/amb/region", "/amb/evidence"
EVIDENCE = ("bias", "input_frequency", "input_amplitude")
"""Features of an axis in a region state that are exported beside its region."""


def write_plotjuggler(telemetry: RunTelemetry, path: Path, topics: Collection[str] = ()) -> None:
    """Write a run as a bag for PlotJuggler.

    Parameters
    ----------
    telemetry : RunTelemetry
        The run.
    path : Path
        The `.mcap` file; must not exist.
    topics : collection of str, optional
        `reference`, `position`, `current`, `region`, `status` or `spectrum`; by default all of them.

    Raises
    ------
    BagError
        If there is no such topic, or the bag cannot be read on.
    OSError
        If the file cannot be written.
    """
    chosen = chosen_signals(topics, OTHERS)
    loop = [name for name in ("position", "current") if name in chosen]
    wanted = [(LOOP, loop)] * bool(loop) + [(REFERENCE, ["reference"])] * ("reference" in chosen)
    with SampleFile(path, telemetry.sample_time, MessageTypes()) as file:
        joints = [_Joints(file, telemetry.axes, topic, names) for topic, names in wanted]
        spectra = RunSpectra.of(telemetry) if "spectrum" in chosen else None
        for record in telemetry.batches() if joints or spectra else ():
            for topic in joints:
                topic.write(record)
            if spectra:
                spectra.take(record)
        if spectra:
            _write_spectrum(file, telemetry, spectra)
        if "region" in chosen:
            _write_regions(file, telemetry)
        if "status" in chosen:
            _write_status(file, telemetry)


class _Joints:
    """A topic of joint states; the signals are its positions, and its efforts if one is the current."""

    def __init__(self, file: SampleFile, axes: Sequence[str], topic: str, signals: Sequence[str]) -> None:
        self._file, self._topic, self._signals = file, topic, signals
        types, unknown = file.types, [math.nan] * len(axes)

        def serialize(seconds: int, nanoseconds: int, _: list[int], numbers: list[float]) -> bytes:
            of_signal = {name: numbers[len(axes) * place :][: len(axes)] for place, name in enumerate(signals)}
            effort = of_signal.pop("current", unknown)
            position = next(iter(of_signal.values()), unknown)
            arrays = (np.array(values, dtype=np.float64) for values in (position, unknown, effort))
            return types.serialize(types.message(JOINTS, types.header(seconds, nanoseconds), list(axes), *arrays))

        self._rows = MessageRows(serialize, 0, len(axes) * len(signals))
        file.add_topic(topic, JOINTS)

    def write(self, record: LoopRecord) -> None:
        """Write the messages of samples."""
        columns = [getattr(record, name)[:, axis] for name in self._signals for axis in range(len(record.axes))]
        times = self._file.times(record.first_step + np.arange(record.steps))
        self._file.write_all(self._topic, times, self._rows.messages(times, columns))


def _write_spectrum(file: SampleFile, telemetry: RunTelemetry, spectra: RunSpectra) -> None:
    """Write the largest amplitudes over frequency, a point for each step: PlotJuggler draws one topic over another."""
    if spectra.peak is None:
        return
    first = telemetry.spans[0][0]
    columns = {FREQUENCY: spectra.peak.frequency}
    columns |= {f"{SPECTRUM}/{axis}": spectra.peak.amplitude[:, index] for index, axis in enumerate(telemetry.axes)}
    for topic, values in columns.items():
        file.add_topic(topic, NUMBER)
        for place, value in enumerate(values.tolist()):
            file.write(topic, file.types.message(NUMBER, value), first + place)


def _write_regions(file: SampleFile, telemetry: RunTelemetry) -> None:
    """Write the region of each axis (0 to 3 for A to D), and some of the evidence."""
    from amb_core.recording.messages.region_state import region_state_from_message  # loads a compiler

    known: set[str] = set()
    for state in state_messages(telemetry, [REGION_STATE]):
        for axis in region_state_from_message(state.message).axes:
            numbers = {f"{EVIDENCE_TOPIC}/{axis.name}/{name}": float(getattr(axis, name)) for name in EVIDENCE}
            for topic, value in ({f"{REGION}/{axis.name}": int(axis.region)} | numbers).items():
                kind = SMALL if isinstance(value, int) else NUMBER
                if topic not in known:
                    file.add_topic(topic, kind)
                    known.add(topic)
                file.write(topic, file.types.message(kind, value), state.step)


def _write_status(file: SampleFile, telemetry: RunTelemetry) -> None:
    """Write how many samples are missing so far, and the mode of simulator or bridge."""
    file.add_topic(MISSING, COUNT)
    first, stop = telemetry.spans[0][0], telemetry.spans[-1][1] - 1
    file.write(MISSING, file.types.message(COUNT, 0), first)
    lost = 0
    for start, end in telemetry.missing:
        lost += end - start
        file.write(MISSING, file.types.message(COUNT, lost), end)
    file.write(MISSING, file.types.message(COUNT, lost), stop)
    for number, state in enumerate(state_messages(telemetry, MODES)):
        if not number:
            file.add_topic(MODE, SMALL)
        file.write(MODE, file.types.message(SMALL, int(state.message.mode)), state.step)
