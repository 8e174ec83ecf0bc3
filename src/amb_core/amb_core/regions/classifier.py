"""The streaming classifier of regions: of all axes and bearings of a machine."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import RegionError
from amb_core.loop.records import LoopRecord
from amb_core.regions.axis import AxisClassifier, gain
from amb_core.regions.contact import Contact
from amb_core.regions.front_end import FrontEnd
from amb_core.regions.history import InputHistory
from amb_core.regions.input_signal import ExcitationChange, InputKind
from amb_core.regions.judged import Judged, SearchedUpdates, TestedUpdates
from amb_core.regions.layout import ONE_BEARING, Layout, MonitoredBearing
from amb_core.regions.parameters import PER_INTERVAL, RegionParameters
from amb_core.regions.slow_signal import TAPS
from amb_core.regions.state import AxisState, BearingState, Onset, Region, RegionState


class RegionClassifier:
    """Classifies streamed telemetry in blocks of any size: the states depend on the samples alone.

    It returns a state at every multiple of the update interval, and also at the step at which the rotor touches a
    bearing. An axis without an input of its own may respond to that of any other axis. While the rotor touches one
    bearing, and while the loop settles after an excitation of any axis, B and C are evaluated on no axis.

    Parameters
    ----------
    parameters : RegionParameters
        Thresholds and times; see `RegionParameters.for_sample_time`.
    sample_time : float
        Controller sample time (s).
    layout : Layout, optional
        Axes and bearings; by default x and y of a single bearing, whose clearance is not known.

    Attributes
    ----------
    parameters : RegionParameters
        Those in use.
    gaps : list of tuple of int
        Missing spans of steps (first, step after the last); the classification restarted after each.
    returns : list of tuple of int
        Where a block began before the end of the last one (that end, its first step); the classification restarted.

    Raises
    ------
    RegionError
        If the sample time is too long; see `RegionParameters.for_sample_time`.
    """

    def __init__(self, parameters: RegionParameters, sample_time: float, layout: Layout = ONE_BEARING) -> None:
        if not (math.isfinite(sample_time) and sample_time > 0.0):
            raise RegionError(f"sample time {sample_time!r} s is not allowed; it must be positive and finite")
        self.parameters = parameters = parameters.for_sample_time(sample_time)
        self.sample_time = sample_time
        self.layout = layout
        self._count = len(layout.axes)
        self._neighbours = layout.neighbours()
        self._factor = round(parameters.update_interval / sample_time / PER_INTERVAL)
        self._interval = PER_INTERVAL * self._factor
        update = self._interval * sample_time
        self._samples = PER_INTERVAL * round(parameters.oscillation_window / update)
        self._settling = math.ceil(parameters.settling_time / update)
        self.gaps: list[tuple[int, int]] = []
        self.returns: list[tuple[int, int]] = []
        self._next: int | None = None
        self._held = np.empty((self._interval, 2 * self._count))
        self._tested = [TestedUpdates() for _ in layout.axes]
        self._searched = [SearchedUpdates() for _ in layout.axes]
        self._restart(0)

    @property
    def judged(self) -> Judged:
        """What was judged so far at all."""
        axes = self.layout.axes
        contact = {axis: math.isfinite(self._contact_of[column].clearance) for column, axis in enumerate(axes)}
        tested = dict(zip(axes, self._tested, strict=True))
        searched = dict(zip(axes, self._searched, strict=True))
        return Judged(tested, contact, self.parameters.resonance_gain, searched)

    def feed(self, block: LoopRecord) -> list[RegionState]:
        """Take in a block of telemetry; the states that it completes, oldest first.

        A block that does not continue the last one restarts the classification at its first step.

        Parameters
        ----------
        block : LoopRecord
            Consecutive samples.

        Returns
        -------
        list of RegionState
            One state for each completed update.

        Raises
        ------
        RegionError
            If a sample is not finite (the whole block is then ignored), or the sample time or the axes differ.
        """
        self._check(block)
        if block.steps == 0:
            return []
        if self._next is not None and block.first_step != self._next:
            if block.first_step > self._next:
                self.gaps.append((self._next, block.first_step))
            else:
                self.returns.append((self._next, block.first_step))
            self._restart(block.first_step)
        elif self._next is None:
            self._restart(block.first_step)
        signals = np.hstack([block.reference, block.position])
        states: list[RegionState] = []
        done = 0
        while done < block.steps:
            filled = (block.first_step + done) % self._interval
            taken = min(self._interval - filled, block.steps - done)
            self._held[filled : filled + taken] = signals[done : done + taken]
            self._next = block.first_step + done + taken
            states += self._watch_contact(signals[done : done + taken, self._count :], self._next - taken)
            if filled + taken == self._interval:
                self._update()
                states.append(self._state())
                for contact in self._contacts:
                    contact.radius = 0.0
            done += taken
        return states

    def delevitate(self) -> RegionState:
        """Register that the rotor delevitated at the next step, for which there is no sample.

        Of several bearings it is the one in which the last position was closest to its clearance.

        Returns
        -------
        RegionState
            The state at that step.
        """
        if not self._touching:
            self._begin_delevitation(0 if self._next is None else self._next, [self._closest_contact()])
        return self._state()

    def _check(self, block: LoopRecord) -> None:
        if abs(block.sample_time - self.sample_time) > 1e-9 * self.sample_time:
            raise RegionError(
                f"telemetry: the sample time is {block.sample_time:g} s at step {block.first_step}; "
                f"the classifier was made for {self.sample_time:g} s"
            )
        if block.axes != self.layout.axes:
            raise RegionError(
                f"telemetry: the axes are {', '.join(block.axes)} at step {block.first_step}; "
                f"the classifier was made for {', '.join(self.layout.axes)}"
            )
        for name, signal in (("reference", block.reference), ("position", block.position)):
            wrong = np.argwhere(~np.isfinite(signal))
            if len(wrong):
                row, axis = wrong[0]
                raise RegionError(
                    f"telemetry: {name} {block.axes[axis]} is {signal[row, axis]} at step {block.first_step + row}; "
                    "samples must be finite"
                )

    def _restart(self, step: int) -> None:
        """Forget everything: the next sample is the first."""
        parameters = self.parameters
        self._front_end = FrontEnd(self.sample_time, self._factor, self._samples, self._neighbours)
        self._history = InputHistory(self.sample_time, parameters.resonance_gain, self._count)
        self._axes = [
            AxisClassifier(
                axis, parameters, self._front_end, self._history, self.sample_time, self._interval, tested, searched
            )
            for axis, (tested, searched) in enumerate(zip(self._tested, self._searched, strict=True))
        ]
        # an interval without its start is left out
        self._first_whole = math.ceil(step / self._interval) * self._interval
        self._contacts = [self._contact(bearing) for bearing in self.layout.bearings]
        self._contact_of = {column: contact for contact in self._contacts for column in contact.columns}
        self._judged = step
        self._linear = [Onset(step, step * self.sample_time, math.nan, False)] * self._count
        self._changes = [ExcitationChange(self._interval * self.sample_time) for _ in range(self._count)]
        self._excited = False
        self._settle()

    def _settle(self) -> None:
        """Classify nothing until the transient is over and has left the windows.

        `_unsettled` counts the updates until then, and below 0 those since.
        """
        self._unsettled = self._settling + (self._samples + TAPS) // PER_INTERVAL + 1
        self._settled_for = self._quiet = 0
        for number, axis in enumerate(self._axes):
            if axis.drift or axis.oscillation:
                self._begin_linear(number)
            axis.reset()

    def _begin_linear(self, axis: int) -> None:
        """Region A of an axis, if it turns out to be A, begins at the latest step: a higher one has ended."""
        assert self._next is not None
        self._linear[axis] = self._history.onset(self._next - 1, axis)

    def _contact(self, bearing: MonitoredBearing) -> Contact:
        """A bearing without contact; `backup_bearing_radius` replaces the clearance of every radial one."""
        radius = self.parameters.backup_bearing_radius
        clearance = radius if radius > 0.0 and bearing.radial else bearing.clearance
        return Contact(bearing.name, self.layout.columns(bearing), clearance)

    @property
    def _touching(self) -> list[Contact]:
        return [contact for contact in self._contacts if contact.since is not None]

    def _closest_contact(self) -> Contact:
        """The bearing in which the last position was closest to its clearance; the first one before any position."""
        if self._next is None:
            return self._contacts[0]
        row = (self._next - 1) % self._interval
        position = self._held[row : row + 1, self._count :]
        return max(self._contacts, key=lambda contact: float(contact.displacement(position)[0]) / contact.clearance)

    def _watch_contact(self, position: NDArray[np.float64], first_step: int) -> list[RegionState]:
        """Region D: the rotor at a backup bearing."""
        displacements = [contact.displacement(position) for contact in self._contacts]
        rows = [contact.touched(part) for contact, part in zip(self._contacts, displacements, strict=True)]
        states: list[RegionState] = []
        for row in sorted({row for row in rows if row is not None}):
            for contact, part in zip(self._contacts, displacements, strict=True):
                contact.note(part[: row + 1])
            touched = [contact for contact, at in zip(self._contacts, rows, strict=True) if at == row]
            self._begin_delevitation(first_step + row, touched)
            states.append(self._state(first_step + row))
        for contact, part in zip(self._contacts, displacements, strict=True):
            contact.note(part)
        return states

    def _begin_delevitation(self, step: int, contacts: Sequence[Contact]) -> None:
        if self._unsettled <= 0 and not self._touching:
            for axis in self._axes:
                axis.conclude(self._judged)
        for contact in contacts:
            contact.begin(self._onset(step, contact.columns))

    def _leave_backup_bearing(self) -> None:
        """Region D ends when the rotor has stayed clear of the backup bearing for the hold time."""
        touching = self._touching
        for contact in touching:
            if contact.count_clear() * self._interval * self.sample_time > self.parameters.hold_time:
                contact.since = None
                for axis in contact.columns:
                    self._begin_linear(axis)
        if touching and not self._touching:
            self._settle()

    def _onset(self, step: int, axes: Sequence[int]) -> Onset:
        """An onset of a bearing, with the input of the axis that responds most; the last one if all are alike."""
        onsets = [self._history.onset(step, axis) for axis in reversed(axes)]
        onset = max(onsets, key=lambda onset: (onset.resonance, not math.isnan(onset.input_frequency)))
        return replace(onset, resonance=onset.resonance or any(self._follows(axis) for axis in axes))

    def _follows(self, axis: int) -> bool:
        """Whether an axis moves with an input that is not (yet) a sine, as at the slow start of a sweep."""
        front_end = self._front_end
        if front_end.input_of(axis).kind != InputKind.OTHER:
            return False
        moved, asked = np.ptp(front_end.position[axis]), np.ptp(front_end.reference[front_end.sources[axis]])
        return bool(moved >= self.parameters.resonance_gain * asked > 0.0)

    def _update(self) -> None:
        """Evaluate a complete interval."""
        assert self._next is not None
        if self._next - self._interval < self._first_whole:
            return
        self._leave_backup_bearing()
        if not self._front_end.take(self._held[:, : self._count], self._held[:, self._count :]):
            return
        self._follow_steady_lines()
        self._note_inputs()
        self._unsettled -= 1
        if self._unsettled > 0 or self._touching:
            return
        self._judged = self._next - 1 - self._front_end.delay
        for axis in range(self._count):
            before = self._axes[axis].drift or self._axes[axis].oscillation
            self._axes[axis].update(self._judged)
            if before and not (self._axes[axis].drift or self._axes[axis].oscillation):
                self._begin_linear(axis)

    def _follow_steady_lines(self) -> None:
        """Look for lines while there is no input: at every doubling of this time, and when an input begins."""
        for axis in self._axes:
            axis.steady.proceed()
        self._settled_for += 1
        if any(source.kind != InputKind.NONE for source in self._front_end.inputs):
            if self._quiet >= self._samples:
                self._adopt_steady_lines(before=PER_INTERVAL)
            self._quiet = 0
            self._excited = True
        elif self._settled_for > self._settling + TAPS // PER_INTERVAL:
            self._quiet += PER_INTERVAL
            rounds = self._quiet / self._samples
            if rounds >= 1.0 and math.log2(rounds).is_integer():
                self._adopt_steady_lines(before=0)

    def _adopt_steady_lines(self, before: int) -> None:
        """Steady lines of the quiet time, which ended that many decimated samples ago."""
        quiet = self._front_end.past.positions(self._quiet + before)
        for number, axis in enumerate(self._axes):
            axis.adopt_steady_lines(quiet[: len(quiet) - before, number], before, self._excited)

    def _note_inputs(self) -> None:
        """Store the inputs for the onsets, and settle again if the excitation changed."""
        assert self._next is not None
        steps, frequencies, gains = [], [], []
        changed = False
        for axis in range(self._count):
            source = self._front_end.input_of(axis)
            steps.append(self._next - 1 - source.span * self._interval // 2)
            frequencies.append(source.frequency if source.kind == InputKind.SINE else math.nan)
            gains.append(self._gain(axis))
            changed = self._changes[axis].update(self._front_end.inputs[axis]) or changed
        self._history.add(steps, frequencies, gains)
        if changed:
            self._settle()

    def _gain(self, axis: int) -> float:
        """Response of an axis per input, 0 where this is no sine."""
        source = self._front_end.input_of(axis)
        if source.kind == InputKind.OTHER:
            return self._front_end.noisy_sine_response(axis)
        return gain(self._front_end.response[axis], source.amplitude) if source.kind == InputKind.SINE else 0.0

    def _state(self, step: int | None = None) -> RegionState:
        """The state at a step, by default the latest one."""
        axes = [self._axis_state(axis) for axis in range(self._count)]
        region = max(axis.region for axis in axes)
        onsets = sorted((axis.since for axis in axes if axis.region == region), key=lambda onset: onset.step)
        since = onsets[-1] if region is Region.A else onsets[0]
        step = (self._next or 1) - 1 if step is None else step
        bearings = tuple(
            BearingState(contact.name, max(axes[column].region for column in contact.columns), contact.radius)
            for contact in self._contacts
        )
        return RegionState(step, tuple(axes), bearings, region, since, self._radius(), self._settled)

    @property
    def _settled(self) -> bool:
        """Whether B and C could have been found."""
        return self._unsettled <= 1 - max(axis.fewest_updates for axis in self._axes)

    def _not_judged(self, axis: int) -> list[Region]:
        """The regions that were not looked for on an axis at this update."""
        judged, contact = self._axes[axis], self._contact_of[axis]
        evaluated = self._settled and not self._touching
        looked_for = {
            Region.B: judged.drift is not None or (evaluated and judged.tests_drift),
            Region.C: judged.oscillation is not None or (evaluated and judged.slow.cause is None),
            Region.D: contact.since is not None or math.isfinite(contact.clearance),
        }
        return [region for region, done in looked_for.items() if not done]

    def _radius(self) -> float:
        """Largest radial position since the last update (m); of a machine without a radial bearing any displacement."""
        radial = [contact.radius for contact in self._contacts if len(contact.columns) > 1]
        return max(radial or [contact.radius for contact in self._contacts])

    def _axis_state(self, axis: int) -> AxisState:
        judged = self._axes[axis]
        features = judged.features
        region, since = Region.A, self._linear[axis]
        for candidate, onset in (
            (Region.B, judged.drift),
            (Region.C, judged.oscillation),
            (Region.D, self._contact_of[axis].since),
        ):
            if onset is not None:
                region, since = candidate, onset
        source = self._front_end.input_of(axis)
        steady = judged.steady.largest
        return AxisState(
            region=region,
            since=since,
            bias=features.bias,
            trend=features.trend,
            trend_significance=features.trend_significance,
            oscillation_amplitude=judged.slow.amplitude,
            oscillation_frequency=judged.slow.frequency,
            input_frequency=source.frequency,
            input_amplitude=source.amplitude,
            response_amplitude=self._front_end.response[axis],
            sampling_beat=judged.slow.sampling_beat,
            drift=judged.drift,
            oscillation=judged.oscillation,
            steady_frequency=steady[0],
            steady_amplitude=steady[1],
            even_distortion=self._front_end.distortion[axis][0],
            odd_distortion=self._front_end.distortion[axis][1],
            frozen=self._front_end.is_frozen(axis),
            not_judged="".join(region.name for region in self._not_judged(axis)),
            name=self.layout.axes[axis],
        )
