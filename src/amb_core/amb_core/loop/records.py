"""The records of a loop run: the content of telemetry and of the plant's states, as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import RecordError
from amb_core.ground.given_values import number, numbers, require_kind, texts, whole_number

_NAMES = {
    1: ("x",),
    2: ("x", "y"),
    3: ("x", "y", "z"),
    4: ("x_a", "y_a", "x_b", "y_b"),
    5: ("x_a", "y_a", "x_b", "y_b", "z"),
}


def sample_rate_of(sample_time: float) -> float:
    """Sample rate (Hz) whose sample time this is (s), bit for bit if it was made from a rate in whole uHz."""
    rate = 1.0 / sample_time
    rounded = round(rate, 6)
    return rounded if rounded and 1.0 / rounded == sample_time else rate


def axis_names(count: int) -> tuple[str, ...]:
    """Names of the axes of a machine with one or two radial bearings, and a thrust bearing; else numbered ones."""
    return _NAMES.get(count) or tuple(f"axis_{number}" for number in range(1, count + 1))


@dataclass(frozen=True)
class LoopRecord:
    """Consecutive samples of the control loop.

    Attributes
    ----------
    first_step : int
        Controller step of the first sample.
    sample_time : float
        Controller sample time 1 / f_s (s).
    reference, position : ndarray, shape (steps, axes)
        Reference position and measured rotor position (m), a column per axis: x and y of a single bearing.
    current : ndarray, shape (steps, axes)
        Control current references after the controller's limit (A).
    axes : tuple of str
        Names of the axes; by default those of a machine with as many, see `axis_names`.

    Raises
    ------
    RecordError
        If the three signals have not one shape, or something is of another type; it is a ValueError too.
    """

    first_step: int
    sample_time: float
    reference: NDArray[np.float64]
    position: NDArray[np.float64]
    current: NDArray[np.float64]
    axes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "first_step", whole_number("first_step", self.first_step, RecordError))
        object.__setattr__(self, "sample_time", number("sample_time", self.sample_time, RecordError))
        for name in ("reference", "position", "current"):
            signal = getattr(self, name)
            if not (isinstance(signal, np.ndarray) and signal.dtype.kind == "f"):
                object.__setattr__(self, name, numbers(name, signal, RecordError))
        shapes = {self.reference.shape, self.position.shape, self.current.shape}
        if len(shapes) != 1 or self.position.ndim != 2 or not self.position.shape[1]:
            raise RecordError(
                f"reference {self.reference.shape}, position {self.position.shape} and current {self.current.shape}: "
                "these shapes are not allowed; allowed: (steps, axes), the same for all three"
            )
        count = self.position.shape[1]
        object.__setattr__(self, "axes", texts("axes", self.axes, RecordError) or axis_names(count))
        if len(self.axes) != count:
            raise RecordError(f"{count} axes have the names {', '.join(self.axes)}; allowed: {count} names")

    @property
    def steps(self) -> int:
        """Number of samples."""
        return len(self.position)

    @property
    def time(self) -> NDArray[np.float64]:
        """Time of each sample from step 0 of the run (s), shape (steps,)."""
        return (self.first_step + np.arange(self.steps, dtype=np.float64)) * self.sample_time

    def window(self, first_step: int, steps: int) -> LoopRecord:
        """The samples of `steps` steps from `first_step` onwards.

        Raises
        ------
        RecordError
            If the record does not contain all of them; it is an IndexError too.
        """
        first_step, steps = (
            whole_number(name, value, RecordError) for name, value in (("first_step", first_step), ("steps", steps))
        )
        start = first_step - self.first_step
        if start < 0 or steps < 1 or start + steps > self.steps:
            raise RecordError(
                f"steps {first_step} to {first_step + steps - 1} requested; "
                f"the record holds {self.first_step} to {self.first_step + self.steps - 1}"
            )
        part = slice(start, start + steps)
        signals = self.reference[part], self.position[part], self.current[part]
        return LoopRecord(first_step, self.sample_time, *signals, self.axes)

    def identical_to(self, other: LoopRecord) -> bool:
        """Whether both records have the same samples bit for bit."""
        require_kind("other", other, LoopRecord, "a LoopRecord", RecordError)
        return (
            self.first_step == other.first_step
            and self.sample_time == other.sample_time
            and all(
                mine.shape == theirs.shape and mine.tobytes() == theirs.tobytes()
                for mine, theirs in (
                    (self.reference, other.reference),
                    (self.position, other.position),
                    (self.current, other.current),
                )
            )
        )


@dataclass(frozen=True)
class PlantRecord:
    """Internal states of the simulated plant at n steps of a run, with b bearings: A alone, or A and B.

    Attributes
    ----------
    step : ndarray, shape (n,)
        Controller steps.
    time : ndarray, shape (n,)
        Time from step 0 of the run (s).
    coil_current : ndarray, shape (n, b, 4)
        Coil currents, electromagnets +x, +y, -x, -y (A).
    flux_density : ndarray, shape (n, b, 8)
        Flux density in the gaps of the poles at 22.5 deg, 67.5 deg, ...; positive from stator to rotor (T).
    force : ndarray, shape (n, b, 2)
        Magnetic force on the rotor, axes x and y (N).
    position : ndarray, shape (n, b, 2)
        Position of the journal itself, not of its sensor (m).
    contact : ndarray of bool, shape (n, b)
        Whether the rotor touches the backup bearing.
    contact_force : ndarray, shape (n, b)
        Magnitude of the force of the backup bearing on the rotor (N).
    """

    step: NDArray[np.int64]
    time: NDArray[np.float64]
    coil_current: NDArray[np.float64]
    flux_density: NDArray[np.float64]
    force: NDArray[np.float64]
    position: NDArray[np.float64]
    contact: NDArray[np.bool_]
    contact_force: NDArray[np.float64]
