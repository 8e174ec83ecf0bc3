"""Telemetry as the live page shows it: columns of time traces, orbits, spectrum; and the binary frames of these."""

from __future__ import annotations

import struct
import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.loop.machine import MOST_AXES, Machine
from amb_core.loop.records import LoopRecord
from amb_core.recording.live import ColumnPyramid, OrbitPath, Plane, RunningSpectrum, planes_of

WINDOW_COLUMNS = 500
KEPT_COLUMNS = WINDOW_COLUMNS + 50  # so that a page may skip a few frames
SHORTEST_WINDOW = 0.1  # s
FACTORS = (1, 5, 4, 5, 6)  # windows of 0.1 s, 0.5 s, 2 s, 10 s and 60 s, as far as the sample rate allows
ORBIT_RATE = 5000.0  # points per second, at most
ORBIT_POINTS = 1000
LARGEST = 1e9  # m or A; beyond it a sample is shown as missing, as one that is not a number
SIGNALS = ("position", "reference", "current")

FRAME, SPECTRUM = 1, 2
_FRAME_HEADER = struct.Struct("<8I4d")
_SPECTRUM_HEADER = struct.Struct("<4I")


@dataclass
class Seen:
    """Where a page stands: the epoch of the display, the level it shows, and the next column and point to send."""

    level: int = 2
    epoch: int = -1
    column: int = 0
    point: int = 0


@dataclass
class _Rate:
    """Steps per second of wall-clock time, over a second or so."""

    since: float = field(default_factory=time.monotonic)
    steps: int = 0
    value: float = 0.0

    def add(self, steps: int) -> None:
        self.steps += steps

    def update(self) -> None:
        now = time.monotonic()
        if now - self.since >= 1.0:
            self.value, self.steps, self.since = self.steps / (now - self.since), 0, now


class SampleDisplay:
    """The samples of one run after the other.

    Attributes
    ----------
    epoch : int
        Counts the runs and layouts; what a page has of an earlier one is no longer valid.
    run, step : int
        Run, and the step after the newest sample.
    axes : tuple of str
        Names of the axes; empty before the first sample.
    sample_time : float
        (s)
    lost : int
        Samples that did not arrive, in this run.
    """

    def __init__(self) -> None:
        self.epoch, self.run, self.step, self.lost = 0, 0, 0, 0
        self.axes: tuple[str, ...] = ()
        self.sample_time = 0.0
        self.planes: tuple[Plane, ...] = ()
        self._machine: Machine | None = None
        self._published = 0.0  # s since the epoch
        self._rate = _Rate()

    def use(self, machine: Machine) -> None:
        """Take the bearings of a machine."""
        if machine != self._machine:
            self._machine = machine
            self._start(self.run, self.axes, self.sample_time)

    def add(self, run: int, block: LoopRecord, published: float) -> None:
        """Take in a block of telemetry that was published at a time (s since the epoch).

        Raises
        ------
        ValueError
            If it has more axes than a machine may have.
        """
        if len(block.axes) > MOST_AXES:
            raise ValueError(f"telemetry of {len(block.axes)} axes; allowed: 1 to {MOST_AXES}")
        if (run, block.axes, block.sample_time) != (self.run, self.axes, self.sample_time):
            self._start(run, block.axes, block.sample_time)
            self.step = block.first_step
        missing = block.first_step - self.step
        if missing < 0 and block.first_step + block.steps <= self.step:
            return  # arrived before
        if missing < 0:
            block = block.window(self.step, block.first_step + block.steps - self.step)
        elif missing:
            self.lost += missing
            self._columns.skip(missing)
            self._orbit.add(np.full((self._stride, len(self.axes)), np.nan))
            self._spectrum.clear()
        self._take(block)
        self._published = published
        self._rate.add(block.steps)

    def layout(self) -> dict[str, Any]:
        """What a page must know to draw the frames of this epoch."""
        if not self.axes:
            return {"epoch": self.epoch, "axes": []}
        return {
            "epoch": self.epoch,
            "run": self.run,
            "axes": list(self.axes),
            "signals": list(SIGNALS),
            "sampleTime": self.sample_time,
            "columns": WINDOW_COLUMNS,
            "columnTimes": [width * self.sample_time for width in self._columns.widths],
            "orbitPoints": ORBIT_POINTS,
            "planes": [
                {"bearing": plane.bearing, "clearance": plane.clearance if np.isfinite(plane.clearance) else None}
                for plane in self.planes
            ],
            "frequency": self._spectrum.frequency.tolist(),
        }

    @property
    def rate(self) -> float:
        """Steps per second of wall-clock time."""
        self._rate.update()
        return self._rate.value

    def frame(self, seen: Seen) -> bytes | None:
        """What is new for a page, which is then where the display stands; None if nothing is.

        A header of eight uint32 (kind, epoch, level, first column, columns, signals, first point of the orbits, points)
        and four float64 (step after the newest sample, its time (s), time of its publication and of this frame (s since
        the epoch)); then float32: smallest and largest values by column, points by plane. SI units.
        """
        if not self.axes:
            return None
        if seen.epoch != self.epoch:
            seen.epoch, seen.column, seen.point = self.epoch, 0, 0
        columns = self._columns.since(seen.level, seen.column)
        point, points = self._orbit.since(seen.point)
        if not len(columns.low) and not len(points):
            return None
        seen.column, seen.point = columns.first + len(columns.low), point + len(points)
        numbers = (columns.first, len(columns.low), columns.low.shape[1], point, len(points))
        times = (float(self.step), self.step * self.sample_time, self._published, time.time())
        header = _FRAME_HEADER.pack(FRAME, self.epoch, seen.level, *(number % 2**32 for number in numbers), *times)
        return b"".join([header, _floats(columns.low), _floats(columns.high), _floats(points)])

    def spectrum(self) -> bytes | None:
        """The spectrum of the positions, without points until there are enough samples; None before the first one.

        A header of four uint32 (kind, epoch, points, axes), then peak amplitudes as float32, by point (m).
        """
        if not self.axes:
            return None
        if not self._spectrum.ready:  # also after samples were lost, where the spectrum of before is no longer true
            return _SPECTRUM_HEADER.pack(SPECTRUM, self.epoch, 0, len(self.axes))
        amplitude = self._spectrum.amplitude()
        return _SPECTRUM_HEADER.pack(SPECTRUM, self.epoch, *amplitude.shape) + _floats(amplitude)

    def _start(self, run: int, axes: tuple[str, ...], sample_time: float) -> None:
        self.epoch += 1
        self.run, self.axes, self.sample_time, self.lost = run, axes, sample_time, 0
        if not axes:
            return
        width = max(1, round(SHORTEST_WINDOW / sample_time / WINDOW_COLUMNS))
        widths = [width * int(factor) for factor in np.cumprod(FACTORS)]
        self._columns = ColumnPyramid(len(SIGNALS) * len(axes), widths, KEPT_COLUMNS)
        machine = self._machine
        self.planes = planes_of(machine) if machine is not None and machine.axis_names == axes else ()
        self._stride = max(1, round(1.0 / (sample_time * ORBIT_RATE)))
        self._orbit = OrbitPath(self.planes, self._stride, ORBIT_POINTS)
        self._spectrum = RunningSpectrum(len(axes), sample_time)

    def _take(self, block: LoopRecord) -> None:
        values = np.concatenate([block.position, block.reference, block.current], axis=1)
        usable = np.abs(values) < LARGEST
        values = np.where(usable, values, np.nan)
        position = values[:, : len(block.axes)]
        self._columns.add(values)
        self._orbit.add(position)
        if usable[:, : len(block.axes)].all():
            self._spectrum.add(position)
        else:
            self._spectrum.clear()
        self.step = block.first_step + block.steps


def _floats(values: NDArray[np.float64]) -> bytes:
    return values.astype("<f4").tobytes()
