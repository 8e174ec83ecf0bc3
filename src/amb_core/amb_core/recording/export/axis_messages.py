"""Messages with a field for each axis of a machine, of types that are made for it: samples of the loop, and spectra."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import BagError
from amb_core.loop.records import LoopRecord
from amb_core.recording.export.columns import SIGNALS
from amb_core.recording.export.message_rows import MessageRows
from amb_core.recording.export.message_types import MessageTypes
from amb_core.recording.export.spectra import Spectrum

AXIS, SAMPLE, SPECTRUM = "amb_export/msg/AxisSample", "amb_export/msg/LoopSample", "amb_export/msg/Spectrum"
_RESERVED = ("header", "run", "step", "frequency")


class AxisMessages:
    """Serialized messages (CDR) of a machine.

    Parameters
    ----------
    axes : sequence of str
        Names of its axes.
    signals : sequence of str, optional
        `reference`, `position`, `current`: what samples hold, by default all of them.

    Attributes
    ----------
    types : MessageTypes
        The types `SAMPLE` (with signals) and `SPECTRUM`, and the standard ones.
    signals : list of str
        What samples hold.

    Raises
    ------
    BagError
        If two axes would have the same field.
    """

    def __init__(self, axes: Sequence[str], signals: Sequence[str] = tuple(SIGNALS)) -> None:
        self.signals = list(signals)
        self.types = MessageTypes(_definitions(axes, signals))
        if not signals:
            return
        types, count = self.types, len(signals)

        def serialize(seconds: int, nanoseconds: int, whole: list[int], numbers: list[float]) -> bytes:
            parts = [types.message(AXIS, *numbers[start : start + count]) for start in range(0, len(numbers), count)]
            return types.serialize(types.message(SAMPLE, types.header(seconds, nanoseconds), *whole, *parts))

        self._rows = MessageRows(serialize, 2, count * len(axes))

    def samples(self, times: NDArray[np.int64], run: int, record: LoopRecord) -> Iterator[bytes]:
        """A message for each sample of a record; times in ns, shape (steps,)."""
        steps = np.arange(record.first_step, record.first_step + record.steps, dtype=np.uint64)
        columns = [getattr(record, name)[:, axis] for axis in range(len(record.axes)) for name in self.signals]
        return self._rows.messages(times, [np.full(len(steps), run, dtype=np.uint64), steps, *columns])

    def spectrum(self, time: int, spectrum: Spectrum) -> bytes:
        """The message of a spectrum; time in ns."""
        amplitudes = (np.ascontiguousarray(column) for column in spectrum.amplitude.T)
        header = self.types.header_at(time)
        return self.types.serialize(self.types.message(SPECTRUM, header, spectrum.frequency, *amplitudes))


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


def _definitions(axes: Sequence[str], signals: Sequence[str]) -> dict[str, str]:
    """Definitions of the messages for a machine with these axes."""
    names = field_names(axes)
    units = "".join(f"float64 {name}  # {SIGNALS[name][1]}\n" for name in signals)
    parts = "".join(f"amb_export/AxisSample {name}\n" for name in names)
    lines = "".join(f"float64[] {name}  # peak amplitude of the position, m\n" for name in names)
    samples = {AXIS: units, SAMPLE: f"std_msgs/Header header\nuint64 run\nuint64 step\n{parts}"} if signals else {}
    return samples | {SPECTRUM: f"std_msgs/Header header\nfloat64[] frequency  # Hz\n{lines}"}
