"""A run for Foxglove: an MCAP file whose messages have a field for each axis, such as `/amb/telemetry.x.position`.

The definitions are in the file, in the form of ROS 2; Foxglove needs nothing else. Each sample is a message with its
stamp. Where samples are missing one message of NaN breaks the lines, at the first missing step. States of regions,
simulator and bridge are those of the bag, at the time of their step. The live bridge sends the same messages.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from amb_core.loop.records import LoopRecord
from amb_core.recording.content import REGION_STATE, SIMULATOR_STATE
from amb_core.recording.export.axis_messages import SAMPLE, SPECTRUM, AxisMessages
from amb_core.recording.export.columns import SIGNALS, chosen_signals
from amb_core.recording.export.message_types import step_times
from amb_core.recording.export.run_telemetry import RunTelemetry
from amb_core.recording.export.sample_file import SampleFile
from amb_core.recording.export.spectra import RunSpectra
from amb_core.recording.export.status import BRIDGE_STATE, state_messages

OTHERS = ("region", "status", "spectrum")
TELEMETRY_TOPIC, SPECTRUM_TOPIC = "/amb/telemetry", "/amb/spectrum"
STATES = {REGION_STATE: "/amb/region", SIMULATOR_STATE: "/amb/simulator/state", BRIDGE_STATE: "/amb/bridge/state"}
"""Topics of the messages that are those of the bag."""


def write_foxglove(telemetry: RunTelemetry, path: Path, topics: Collection[str] = ()) -> None:
    """Write a run as a file for Foxglove.

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
        If there is no such topic, two axes would have the same field, or the bag cannot be read on.
    OSError
        If the file cannot be written.
    """
    chosen = chosen_signals(topics, OTHERS)
    messages = AxisMessages(telemetry.axes, [name for name in SIGNALS if name in chosen])
    with SampleFile(path, telemetry.sample_time, messages.types) as file:
        if messages.signals:
            file.add_topic(TELEMETRY_TOPIC, SAMPLE)
        spectra = RunSpectra.of(telemetry) if "spectrum" in chosen else None
        if spectra:
            file.add_topic(SPECTRUM_TOPIC, SPECTRUM)
        gaps = {stop: start for start, stop in telemetry.missing}
        for record in telemetry.batches() if messages.signals or spectra else ():
            if messages.signals:
                _write_samples(file, messages, telemetry.run, record, gaps.get(record.first_step))
            for spectrum in spectra.add(record) if spectra else ():
                last = spectrum.step - 1
                file.write_stored(SPECTRUM_TOPIC, messages.spectrum(file.time(last), spectrum), last)
        kinds = [REGION_STATE] * ("region" in chosen) + [SIMULATOR_STATE, BRIDGE_STATE] * ("status" in chosen)
        _write_states(file, telemetry, kinds)


def samples_with_gap(
    messages: AxisMessages, run: int, record: LoopRecord, gap: int | None
) -> Iterator[tuple[NDArray[np.int64], Iterator[bytes]]]:
    """Times (ns) and messages of samples, and before them, after a gap that begins at a step, one without numbers."""
    if gap is not None:
        nothing = np.full((1, len(record.axes)), np.nan)
        missing = LoopRecord(gap, record.sample_time, nothing, nothing, nothing, record.axes)
        yield from samples_with_gap(messages, run, missing, None)
    times = step_times(record.first_step + np.arange(record.steps), record.sample_time)
    yield times, messages.samples(times, run, record)


def _write_samples(file: SampleFile, messages: AxisMessages, run: int, record: LoopRecord, gap: int | None) -> None:
    for times, data in samples_with_gap(messages, run, record, gap):
        file.write_all(TELEMETRY_TOPIC, times, data)


def _write_states(file: SampleFile, telemetry: RunTelemetry, kinds: Collection[str]) -> None:
    known: set[str] = set()
    for state in state_messages(telemetry, kinds):
        topic = STATES[state.topic.type]
        if topic not in known:
            file.add_stored_topic(topic, state.topic)
            known.add(topic)
        file.write_stored(topic, state.data, state.step)
