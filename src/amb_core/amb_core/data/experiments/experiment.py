"""An experiment: consecutive samples without a gap, and the trends that were removed from them.

Each experiment has its own initial state. So a record with gaps, several runs and several bags can all become one data
set, although they are not one signal.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from amb_core.ground.errors import IdentificationError
from amb_core.ground.given_values import numbers, whole_number


def _no_trend() -> NDArray[np.float64]:
    """Stands for a trend of zero, whatever the number of signals."""
    return np.zeros((2, 0))


@dataclass(frozen=True, eq=False)
class Experiment:
    """Consecutive samples of m inputs and p outputs; arrays are read-only.

    Attributes
    ----------
    inputs, outputs : ndarray, shapes (steps, m), (steps, p)
        The samples, in the units of the data set; NaN where they are masked.
    reference : ndarray, shape (steps, p), or None
        Setpoint of the outputs, in units of the outputs; None if it is not known.
    first_step : int
        Number of the first sample; sample k is taken at the time k * sample_time of the run.
    source : str
        Run that the samples come from. Experiments of one source are parts of one run, with gaps between them.
    input_trend, output_trend, reference_trend : ndarray, shapes (2, m), (2, p), (2, p)
        The removed trend, in the units of the signals: offset (row 0) + slope (row 1, per second) * time of the run.
        Zero by default.

    Raises
    ------
    IdentificationError
        If the shapes do not fit together, there is no sample, or one is no real number.
    """

    inputs: NDArray[np.float64]
    outputs: NDArray[np.float64]
    reference: NDArray[np.float64] | None = None
    first_step: int = 0
    source: str = ""
    input_trend: NDArray[np.float64] = field(default_factory=_no_trend)
    output_trend: NDArray[np.float64] = field(default_factory=_no_trend)
    reference_trend: NDArray[np.float64] = field(default_factory=_no_trend)

    def __post_init__(self) -> None:
        object.__setattr__(self, "first_step", whole_number("first_step", self.first_step, IdentificationError))
        self._freeze("inputs", self.inputs)
        self._freeze("outputs", self.outputs)
        if self.reference is not None:
            self._freeze("reference", self.reference)
        for name, signals in (("input", self.inputs), ("output", self.outputs), ("reference", self.outputs)):
            trend = getattr(self, f"{name}_trend")
            self._freeze(f"{name}_trend", np.zeros((2, signals.shape[-1])) if np.shape(trend) == (2, 0) else trend)
        self._check()

    @property
    def steps(self) -> int:
        """Number of samples."""
        return len(self.inputs)

    @property
    def stop(self) -> int:
        """Number of the sample after the last."""
        return self.first_step + self.steps

    @property
    def signals(self) -> NDArray[np.float64]:
        """Inputs, outputs and, if known, the reference, side by side; shape (steps, m + p) or (steps, m + 2 p)."""
        known = [self.inputs, self.outputs] + ([] if self.reference is None else [self.reference])
        return np.hstack(known)

    def time(self, sample_time: float) -> NDArray[np.float64]:
        """Time of each sample from step 0 of the run (s), shape (steps,).

        Parameters
        ----------
        sample_time : float
            Sample time (s).

        Returns
        -------
        ndarray, shape (steps,)
            Times (s).
        """
        return np.arange(self.first_step, self.stop, dtype=np.float64) * sample_time

    def mean_trend(self, signal: str, sample_time: float) -> NDArray[np.float64]:
        """The removed trend of `input`, `output` or `reference` in the middle of the experiment.

        Parameters
        ----------
        signal : str
            Which of them.
        sample_time : float
            Sample time (s).

        Returns
        -------
        ndarray, shape (m,) or (p,)
            The trend, in the units of the signals.
        """
        return line(getattr(self, f"{signal}_trend"), np.array([self.time(sample_time).mean()]))[0]

    def window(self, first_step: int, stop: int) -> Experiment:
        """The samples from `first_step` up to, not including, `stop`; there must be at least one.

        Parameters
        ----------
        first_step : int
            First controller step that is kept.
        stop : int
            Step after the last one that is kept.

        Returns
        -------
        Experiment
            The samples of these steps, trends included.
        """
        part = slice(max(first_step - self.first_step, 0), max(stop - self.first_step, 0))
        return replace(
            self,
            inputs=self.inputs[part],
            outputs=self.outputs[part],
            reference=None if self.reference is None else self.reference[part],
            first_step=max(first_step, self.first_step),
        )

    def _freeze(self, name: str, values: ArrayLike) -> None:
        array = np.array(numbers(name, values, IdentificationError), order="C")
        array.flags.writeable = False
        object.__setattr__(self, name, array)

    def _check(self) -> None:
        if self.inputs.ndim != 2 or self.outputs.ndim != 2 or len(self.inputs) != len(self.outputs):
            raise IdentificationError(
                f"inputs {self.inputs.shape} and outputs {self.outputs.shape} must have shapes (steps, m), (steps, p)"
            )
        if self.reference is not None and self.reference.shape != self.outputs.shape:
            raise IdentificationError(
                f"reference {self.reference.shape} must have the shape of the outputs, {self.outputs.shape}"
            )
        if 0 in self.inputs.shape or 0 in self.outputs.shape:
            raise IdentificationError("an experiment needs at least one sample, one input and one output")
        for name, signals in (("input", self.inputs), ("output", self.outputs), ("reference", self.outputs)):
            trend = getattr(self, f"{name}_trend")
            if trend.shape != (2, signals.shape[1]):
                raise IdentificationError(f"{name}_trend has shape {trend.shape}; (2, {signals.shape[1]}) is needed")


def line(trend: NDArray[np.float64], time: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values of a trend (see `Experiment`) at times (s), shape (steps, channels)."""
    offset, slope = trend
    return np.asarray(offset + np.outer(time, slope))
