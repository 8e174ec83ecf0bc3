"""Data for identification: one or several experiments with the same signals at one sample time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from amb_core.data.experiments.experiment import Experiment, line
from amb_core.data.experiments.gap import DataGap, gaps_between
from amb_core.ground.errors import IdentificationError
from amb_core.ground.given_values import kind_of, number, numbers, require_kind, texts, whole_number
from amb_core.loop.records import LoopRecord, sample_rate_of

_MANY_SIGNALS = 16  # with fewer samples than signals, the arrays are transposed


@dataclass(frozen=True, eq=False)
class IdentificationData:
    """Experiments with the same signals at one sample time.

    Values may be anything, NaN included: `check_data` checks them, `split_at_invalid` leaves the invalid ones out.

    Attributes
    ----------
    experiments : tuple of Experiment
        At least one.
    sample_time : float
        Sample time (s).
    input_names, output_names : tuple of str
        Names of the m inputs and p outputs, all different.
    input_units, output_units : tuple of str
        Their units; empty where unknown.
    foreign : bool
        Whether they come from a file of others, so that no controller is assumed where none is named.
    clearance : mapping of str to float
        By output, where it is known: displacement from the centre at which the rotor touches its bearing (m). Without
        it region D is not judged.

    Raises
    ------
    IdentificationError
        If names, units and experiments do not fit together or the sample time is not positive.
    """

    experiments: tuple[Experiment, ...]
    sample_time: float
    input_names: tuple[str, ...] = ("i_x", "i_y")
    output_names: tuple[str, ...] = ("x", "y")
    input_units: tuple[str, ...] = ("A", "A")
    output_units: tuple[str, ...] = ("m", "m")
    foreign: bool = field(default=False, kw_only=True)
    clearance: Mapping[str, float] = field(default_factory=dict, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "experiments", _experiments(self.experiments))
        for name in ("input_names", "output_names", "input_units", "output_units"):
            object.__setattr__(self, name, texts(name, getattr(self, name), IdentificationError))
        object.__setattr__(self, "sample_time", number("sample_time", self.sample_time, IdentificationError))
        self._check()

    @property
    def sample_rate(self) -> float:
        """Sample rate (Hz)."""
        return sample_rate_of(self.sample_time)

    @classmethod
    def from_arrays(
        cls,
        inputs: ArrayLike,
        outputs: ArrayLike,
        sample_time: float,
        *,
        reference: ArrayLike | None = None,
        first_step: int = 0,
        source: str = "",
        input_names: Sequence[str] | None = None,
        output_names: Sequence[str] | None = None,
        input_units: Sequence[str] | None = None,
        output_units: Sequence[str] | None = None,
    ) -> IdentificationData:
        """One experiment from arrays of shapes (steps, m), (steps, p) and (steps, p) or, for one signal, (steps,).

        By default inputs are named u1, u2 ..., outputs y1, y2 ..., and have no units.

        Parameters
        ----------
        inputs : array_like, shape (steps, m) or (steps,)
            Inputs, in the units of `input_units`; masked samples are missing ones.
        outputs : array_like, shape (steps, p) or (steps,)
            Outputs, in the units of `output_units`.
        sample_time : float
            Sample time (s).
        reference : array_like, shape (steps, p) or (steps,), optional
            References, in the units of the outputs; None if there are none.
        first_step : int, optional
            Controller step of the first sample.
        source : str, optional
            Where the samples come from.
        input_names, output_names : sequence of str, optional
            Names of the signals; by default u1, u2 ... and y1, y2 ...
        input_units, output_units : sequence of str, optional
            Units of the signals; none by default.

        Returns
        -------
        IdentificationData
            The data of this experiment.

        Raises
        ------
        IdentificationError
            If the shapes do not fit together, there are many signals and fewer samples, or values are no real numbers.
        """
        u, y = _columns("inputs", inputs), _columns("outputs", outputs)
        for name, values in (("inputs", u), ("outputs", y)):
            if values.ndim == 2 and values.shape[1] > max(values.shape[0], _MANY_SIGNALS):
                raise IdentificationError(
                    f"{name} {values.shape} have more signals than samples; shapes are (steps, signals): transpose them"
                )
        r = None if reference is None else _columns("reference", reference)
        experiment = Experiment(u, y, r, first_step, source)
        m, p = u.shape[1], y.shape[1]
        return cls(
            (experiment,),
            sample_time,
            _given("input_names", input_names) or tuple(f"u{index}" for index in range(1, m + 1)),
            _given("output_names", output_names) or tuple(f"y{index}" for index in range(1, p + 1)),
            _given("input_units", input_units) or ("",) * m,
            _given("output_units", output_units) or ("",) * p,
        )

    @classmethod
    def from_record(cls, record: LoopRecord, source: str = "") -> IdentificationData:
        """One experiment from a record of the loop: control current references (A) to positions (m).

        Parameters
        ----------
        record : LoopRecord
            References (m), positions (m) and currents (A) of the loop.
        source : str, optional
            Where the record comes from.

        Returns
        -------
        IdentificationData
            One experiment; the inputs are named `i_` and the axis.
        """
        require_kind("record", record, LoopRecord, "a LoopRecord", IdentificationError)
        experiment = Experiment(record.current, record.position, record.reference, record.first_step, source)
        inputs = tuple(f"i_{axis}" for axis in record.axes)
        units = (("A",) * len(inputs), ("m",) * len(inputs))
        return cls((experiment,), record.sample_time, inputs, record.axes, *units)

    @property
    def samples(self) -> int:
        """Number of samples of all experiments."""
        return sum(experiment.steps for experiment in self.experiments)

    @property
    def input_offset(self) -> NDArray[np.float64]:
        """Operating point of the inputs: mean of the removed trend, shape (m,)."""
        return self._mean_trend("input")

    @property
    def output_offset(self) -> NDArray[np.float64]:
        """Operating point of the outputs: mean of the removed trend, shape (p,)."""
        return self._mean_trend("output")

    @property
    def gaps(self) -> list[DataGap]:
        """The gaps between experiments of one source, in order."""
        return gaps_between(self.experiments)

    def time(self, index: int = 0) -> NDArray[np.float64]:
        """Time of each sample of an experiment from step 0 of its run (s), shape (steps,).

        Parameters
        ----------
        index : int, optional
            Which experiment.

        Returns
        -------
        ndarray, shape (steps,)
            Times (s).
        """
        return self._experiment(index).time(self.sample_time)

    def subset(self, indices: Iterable[int]) -> IdentificationData:
        """The experiments with these indices, in this order.

        Parameters
        ----------
        indices : iterable of int
            Indices of experiments.

        Returns
        -------
        IdentificationData
            The chosen experiments.
        """
        chosen = indices if isinstance(indices, Iterable) else [indices]
        return replace(self, experiments=tuple(self._experiment(index) for index in chosen))

    def window(self, first_step: int, stop: int) -> IdentificationData:
        """The samples of all experiments from step `first_step` up to, not including, `stop`.

        Parameters
        ----------
        first_step : int
            First controller step that is kept.
        stop : int
            Step after the last one that is kept.

        Returns
        -------
        IdentificationData
            The samples of these steps, of every experiment that has any.

        Raises
        ------
        IdentificationError
            If no sample is left.
        """
        first_step = whole_number("first_step", first_step, IdentificationError)
        stop = whole_number("stop", stop, IdentificationError)
        kept = [item for item in self.experiments if first_step < item.stop and item.first_step < stop > first_step]
        if not kept:
            spans = ", ".join(f"{item.first_step} to {item.stop - 1}" for item in self.experiments[:5])
            raise IdentificationError(f"no samples from step {first_step} to {stop - 1}; the experiments have {spans}")
        return replace(self, experiments=tuple(item.window(first_step, stop) for item in kept))

    def between(self, start: float, end: float) -> IdentificationData:
        """The samples of all experiments from time `start` up to, not including, `end` (s of their runs).

        Parameters
        ----------
        start, end : float
            Times from step 0 of each run (s); both finite.

        Returns
        -------
        IdentificationData
            The samples of that time, of every experiment that has any.

        Raises
        ------
        IdentificationError
            If no sample is left.
        """
        start, end = number("start", start, IdentificationError), number("end", end, IdentificationError)
        if not (math.isfinite(start) and math.isfinite(end)):
            raise IdentificationError(f"times from {start} s to {end} s are not allowed; they must be finite")
        # rounding: a time very close to a step is that step
        return self.window(*(math.ceil(time / self.sample_time - 1e-6) for time in (start, end)))

    def split(self, share: float = 0.5) -> tuple[IdentificationData, IdentificationData]:
        """The first share of the samples and the rest, for identification and validation.

        Parameters
        ----------
        share : float, optional
            Part of all samples that comes first (-), between 0 and 1.

        Returns
        -------
        tuple of IdentificationData
            The first part and the rest; an experiment that the boundary crosses is divided.

        Raises
        ------
        IdentificationError
            If either part would be empty.
        """
        share = number("share", share, IdentificationError)
        before = round(share * self.samples) if math.isfinite(share) else 0
        if not 0 < before < self.samples:
            raise IdentificationError(f"a share of {share} of {self.samples} samples leaves a part without samples")
        first, second = [], []
        for item in self.experiments:
            cut = item.first_step + min(max(before, 0), item.steps)
            if cut > item.first_step:
                first.append(item.window(item.first_step, cut))
            if cut < item.stop:
                second.append(item.window(cut, item.stop))
            before -= item.steps
        return replace(self, experiments=tuple(first)), replace(self, experiments=tuple(second))

    def select(self, inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None) -> IdentificationData:
        """Only the named inputs and outputs, in this order; all by default.

        Parameters
        ----------
        inputs, outputs : sequence of str, optional
            Names of the signals to keep; None for all.

        Returns
        -------
        IdentificationData
            The same experiments with these signals.

        Raises
        ------
        IdentificationError
            If a name is unknown.
        """
        ins = [_position(name, self.input_names, "input") for name in _given("inputs", inputs) or self.input_names]
        names = _given("outputs", outputs) or self.output_names
        outs = [_position(name, self.output_names, "output") for name in names]
        experiments = tuple(
            replace(
                item,
                inputs=item.inputs[:, ins],
                outputs=item.outputs[:, outs],
                reference=None if item.reference is None else item.reference[:, outs],
                input_trend=item.input_trend[:, ins],
                output_trend=item.output_trend[:, outs],
                reference_trend=item.reference_trend[:, outs],
            )
            for item in self.experiments
        )
        return IdentificationData(
            experiments,
            self.sample_time,
            tuple(self.input_names[index] for index in ins),
            tuple(self.output_names[index] for index in outs),
            tuple(self.input_units[index] for index in ins),
            tuple(self.output_units[index] for index in outs),
            foreign=self.foreign,
            clearance=self.clearance,
        )

    def record(self, index: int = 0) -> LoopRecord:
        """An experiment as a record of the loop, with its trends added again.

        Parameters
        ----------
        index : int, optional
            Which experiment.

        Returns
        -------
        LoopRecord
            References, positions and currents at the sample time of the data.

        Raises
        ------
        IdentificationError
            If it has no reference, or not two inputs in A and two outputs in m.
        """
        item = self._experiment(index)
        if item.reference is None:
            raise IdentificationError(
                "a record of the loop needs the reference, which these data lack; name its columns with --reference"
            )
        axes = len(self.output_names)
        if self.input_units != ("A",) * axes or self.output_units != ("m",) * axes:
            raise IdentificationError(
                "a record of the loop has as many inputs in A as outputs in m; "
                f"these data have {', '.join(map(_label, self.input_names, self.input_units))} "
                f"and {', '.join(map(_label, self.output_names, self.output_units))}; units are given with --units"
            )
        time = item.time(self.sample_time)
        return LoopRecord(
            item.first_step,
            self.sample_time,
            item.reference + line(item.reference_trend, time),
            item.outputs + line(item.output_trend, time),
            item.inputs + line(item.input_trend, time),
            self.output_names,
        )

    def _experiment(self, index: int) -> Experiment:
        chosen = whole_number("the index of an experiment", index, IdentificationError)
        if not -len(self.experiments) <= chosen < len(self.experiments):
            raise IdentificationError(f"there is no experiment {chosen}; allowed: 0 to {len(self.experiments) - 1}")
        return self.experiments[chosen]

    def _mean_trend(self, signal: str) -> NDArray[np.float64]:
        weights = [item.steps / self.samples for item in self.experiments]
        means = [item.mean_trend(signal, self.sample_time) for item in self.experiments]
        return np.asarray(np.tensordot(weights, means, axes=1))

    def _check(self) -> None:
        if not (math.isfinite(self.sample_time) and self.sample_time > 0.0):
            raise IdentificationError(f"'sample_time' = {self.sample_time!r} s is not allowed; it must be positive")
        if not self.experiments:
            raise IdentificationError("data need at least one experiment")
        names = (*self.input_names, *self.output_names)
        if len(set(names)) < len(names) or "" in names:
            raise IdentificationError(f"the names {', '.join(names)} must all be different, and none empty")
        for label in (*names, *self.input_units, *self.output_units):
            if not label.isprintable():
                raise IdentificationError(f"{label!r} is not allowed as a name or unit; it must be printable")
        for kind in ("input", "output"):
            names, units = getattr(self, f"{kind}_names"), getattr(self, f"{kind}_units")
            if len(units) != len(names):
                raise IdentificationError(f"{len(names)} {kind}s need as many units, not {len(units)}")
            for index, item in enumerate(self.experiments):
                columns = getattr(item, f"{kind}s").shape[1]
                if columns != len(names):
                    raise IdentificationError(f"experiment {index} has {columns} {kind}s; {len(names)} are named")


def require_data(data: object) -> None:
    """Raise IdentificationError for what is no IdentificationData."""
    if not isinstance(data, IdentificationData):
        raise IdentificationError(
            f"data: {kind_of(data)} is not allowed; allowed: IdentificationData, such as `data` of what amb_core.read "
            "returns, from_record(record) or from_arrays(inputs, outputs, sample_time)"
        )


def _experiments(given: object) -> tuple[Experiment, ...]:
    experiments = tuple(given) if isinstance(given, Iterable) else (given,)
    for item in experiments:
        require_kind("experiments", item, Experiment, "several of type Experiment", IdentificationError)
    return experiments


def _given(name: str, values: Sequence[str] | None) -> tuple[str, ...]:
    return () if values is None else texts(name, values, IdentificationError)


def _columns(name: str, values: ArrayLike) -> NDArray[np.float64]:
    array = numbers(name, values, IdentificationError)
    return array[:, np.newaxis] if array.ndim == 1 else array


def _position(name: str, names: tuple[str, ...], kind: str) -> int:
    if name not in names:
        raise IdentificationError(f"there is no {kind} {name!r}; there are {', '.join(names)}")
    return names.index(name)


def _label(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name
