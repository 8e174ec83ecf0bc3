"""A run for Foxglove: an MCAP file whose messages have a field for each axis, such as `/amb/telemetry.x.position`.

The definitions are in the file, in the form of ROS 2; Foxglove needs nothing else. Each sample is a
message with its stamp. Where samples are missing one message of NaN breaks the lines, at the first missing step. States
of regions, simulator and bridge are those of the bag, at the time of their step.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from amb_core.errors import BagError
from amb_core.export.columns import SIGNALS, chosen_signals
from amb_core.export.message_rows import MessageRows
from amb_core.export.run_telemetry import RunTelemetry
from amb_core.export.sample_file import SampleFile
from amb_core.export.spectra import RunSpectra, Spectrum
from amb_core.export.status import BRIDGE_STATE, state_messages
from amb_core.loop.records import LoopRecord
from amb_core.recording.content import REGION_STATE, SIMULATOR_STATE

OTHERS = ("region", "status", "spectrum")
AXIS, SAMPLE, SPECTRUM = "amb_export/msg/AxisSample", "amb_export/msg/LoopSample", "amb_export/msg/Spectrum"
TELEMETRY_TOPIC, SPECTRUM_TOPIC = "/amb/telemetry", "/amb/spectrum"
STATES = {REGION_STATE: "/amb/region", SIMULATOR_STATE: "/amb/simulator/state", BRIDGE_STATE: "/amb/bridge/state"}
"""Topics of the messages that are those of the bag."""
_RESERVED = ("header", "run", "step", "frequency")


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
    signals = [name for name in SIGNALS if name in chosen]
    with SampleFile(path, telemetry.sample_time, _definitions(telemetry.axes, signals)) as file:
        samples = _Samples(file, telemetry, signals) if signals else None
        spectra = _Spectra(file, telemetry) if "spectrum" in chosen else None
        for record in telemetry.batches() if samples or spectra else ():
            if samples:
                samples.write(record)
            if spectra:
                spectra.write(record)
        kinds = [REGION_STATE] * ("region" in chosen) + [SIMULATOR_STATE, BRIDGE_STATE] * ("status" in chosen)
        known: set[str] = set()
        for found in state_messages(telemetry, kinds):
            topic = STATES[found.topic.type]
            if topic not in known:
                file.add_stored_topic(topic, found.topic)
                known.add(topic)
            file.write_stored(topic, found.data, found.step)


def field_names(axes: Sequence[str]) -> list[str]:
    """Names of message fields for the axes: small letters, digits and underscores, the first one a letter.

    Raises
    ------
    BagError
        If two axes would have the same one.
    """
    names = [re.sub(r"_+", "_", re.sub(r"[^a-z0-9]", "_", axis.lower())).strip("_") for axis in axes]
    names = [name if name[:1].isalpha() and name not in _RESERVED else f"axis_{name}".rstrip("_") for name in names]
    if len(set(names)) < len(names):
        raise BagError(f"axes {', '.join(axes)}: two would have the same field; fields: {', '.join(names)}")
    return names


class _Samples:
    """The topic of samples."""

    def __init__(self, file: SampleFile, telemetry: RunTelemetry, signals: Sequence[str]) -> None:
        self._file, self._run, self._signals = file, telemetry.run, signals
        self._gaps = {stop: start for start, stop in telemetry.missing}
        count = len(signals)

        def serialize(seconds: int, nanoseconds: int, whole: list[int], numbers: list[float]) -> bytes:
            header = file.header(seconds, nanoseconds)
            axes = [file.message(AXIS, *numbers[start : start + count]) for start in range(0, len(numbers), count)]
            return file.serialize(file.message(SAMPLE, header, *whole, *axes))

        self._rows = MessageRows(serialize, 2, count * len(telemetry.axes))
        file.add_topic(TELEMETRY_TOPIC, SAMPLE)

    def write(self, record: LoopRecord) -> None:
        """Write a message for each sample; before those after a gap one without numbers."""
        steps = record.first_step + np.arange(record.steps)
        columns = [getattr(record, name)[:, axis] for axis in range(len(record.axes)) for name in self._signals]
        if record.first_step in self._gaps:
            nothing = np.array([self._gaps[record.first_step]])
            self._write(nothing, [np.full(1, np.nan)] * len(columns))
        self._write(steps, columns)

    def _write(self, steps: np.ndarray[tuple[int], np.dtype[np.int64]], columns: Sequence[np.ndarray]) -> None:
        run = np.full(len(steps), self._run, dtype=np.uint64)
        self._file.write_rows(TELEMETRY_TOPIC, self._rows, steps, [run, steps.astype(np.uint64), *columns])


class _Spectra:
    """The topic of spectra."""

    def __init__(self, file: SampleFile, telemetry: RunTelemetry) -> None:
        self._file, self._spectra = file, RunSpectra(telemetry)
        file.add_topic(SPECTRUM_TOPIC, SPECTRUM)

    def write(self, record: LoopRecord) -> None:
        """Write the spectra that these samples complete."""
        for found in self._spectra.add(record):
            self._file.write(SPECTRUM_TOPIC, self._message(found), found.step - 1)

    def _message(self, found: Spectrum) -> object:
        header = self._file.header_at(found.step - 1)
        amplitudes = (np.ascontiguousarray(column) for column in found.amplitude.T)
        return self._file.message(SPECTRUM, header, found.frequency, *amplitudes)


def _definitions(axes: Sequence[str], signals: Sequence[str]) -> dict[str, str]:
    """Definitions of the messages for a machine with these axes."""
    names = field_names(axes)
    units = "".join(f"float64 {name}  # {SIGNALS[name][1]}\n" for name in signals)
    parts = "".join(f"amb_export/AxisSample {name}\n" for name in names)
    lines = "".join(f"float64[] {name}  # peak amplitude of the position, m\n" for name in names)
    samples = {AXIS: units, SAMPLE: f"std_msgs/Header header\nuint64 run\nuint64 step\n{parts}"} if signals else {}
    return samples | {SPECTRUM: f"std_msgs/Header header\nfloat64[] frequency  # Hz\n{lines}"}
