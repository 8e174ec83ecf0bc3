"""A target behind its link, as a commissioning uses it: records at rest, with tones before lift-off, and levitated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import ExcitationError, TargetError
from amb_core.loop.known_controller import KnownController, LinearControl
from amb_core.loop.linear_parameters import LinearControllerParameters
from amb_core.loop.records import LoopRecord
from amb_core.rig.commissioning.tones import ToneSet, generator_of
from amb_core.rig.link import TelemetryBlock
from amb_core.rig.link.answers import TargetStatus
from amb_core.rig.link.layout import TargetState
from amb_core.rig.link.link import (
    LevitatedError,
    LinkListener,
    RebootedError,
    TargetDescription,
    TargetLink,
    TargetSettings,
)
from amb_core.rig.protection import require_amplitude_and_slew

SMALL = 0.02
"""Peak of control currents before the first lift-off, over the bias current. On the backup bearing of the paper's
machine an amplifier of twice its gain then pushes with a quarter of the pull that one magnet has on a centred rotor."""
_RAMP = 60.0  # s: as slowly as the target allows, so that its reference stays where the rotor lies


@dataclass
class Samples(LinkListener):
    """What has come from the target."""

    blocks: list[TelemetryBlock] = field(default_factory=list)
    reached: int = 0
    rebooted: bool = False

    def on_samples(self, block: TelemetryBlock) -> None:
        """Keep them."""
        self.blocks.append(block)
        self.reached = block.first_step + block.steps

    def on_status(self, status: TargetStatus) -> None:
        """The status is asked for."""

    def on_silence(self) -> None:
        """Commands then fail."""

    def on_return(self, description: TargetDescription, rebooted: bool) -> None:
        """A reboot ends what goes on."""
        self.rebooted = self.rebooted or rebooted


class LostSamplesError(TargetError):
    """Telemetry was lost: nothing is known about the rig."""


DISTURBANCES = (LostSamplesError, RebootedError, LevitatedError)
"""Errors that are no fault of the rig."""


class Bench:
    """A target for commissioning.

    Parameters
    ----------
    link : TargetLink
        Not connected yet.
    settings_of : callable
        Returns the settings with which the rotor is to be levitated, for the description of the target.
    wait : callable
        Waits until the target has made the step with this number.

    Attributes
    ----------
    description : TargetDescription
        Of the target.
    has_levitated : bool
        Whether this object has levitated the rotor and not landed it since; it lands no other.
    """

    def __init__(
        self,
        link: TargetLink,
        settings_of: Callable[[TargetDescription], TargetSettings],
        wait: Callable[[int], None],
    ) -> None:
        self._link, self._wait, self._samples = link, wait, Samples()
        self._step, self.has_levitated = 0, False
        self.description = link.connect(self._samples)
        self.machine = self.description.machine
        self._settings = settings_of(self.description)

    @property
    def rate(self) -> float:
        """Sample rate (Hz)."""
        return self.machine.sample_rate

    @property
    def reached(self) -> int:
        """The step after the last sample that has come: all before it have, or were lost."""
        return self._samples.reached

    def status(self) -> TargetStatus:
        """The state of the target now.

        Returns
        -------
        TargetStatus
            State, trips and counts of the target.

        Raises
        ------
        RebootedError
            If it has been started anew since it was connected.
        """
        status = self._link.status()
        if self._samples.rebooted or status.step < self._step:
            self.has_levitated = False  # nobody's loop outlasts a boot
            raise RebootedError
        self._step = status.step
        return status

    def record(self, seconds: float, first: int | None = None) -> LoopRecord:
        """Samples from now on, or from a step on.

        Parameters
        ----------
        seconds : float
            Duration (s).
        first : int, optional
            First step of the target; by default the present one.

        Returns
        -------
        LoopRecord
            These samples.

        Raises
        ------
        LostSamplesError
            If some were lost.
        """
        begin = self.status().step if first is None else first
        steps = round(seconds * self.rate)
        self._wait(begin + steps)
        return self.past(begin, steps)

    def past(self, first: int, steps: int) -> LoopRecord:
        """Samples that have come already.

        Parameters
        ----------
        first : int
            First step of the target.
        steps : int
            Number of samples.

        Returns
        -------
        LoopRecord
            These samples.

        Raises
        ------
        LostSamplesError
            If some were lost.
        """
        stop = first + steps
        parts = [
            block.part(max(first - block.first_step, 0), min(stop - block.first_step, block.steps))
            for block in self._samples.blocks
            if block.first_step < stop and block.first_step + block.steps > first
        ]
        if sum(part.steps for part in parts) != steps:
            raise LostSamplesError("telemetry was lost; try again")
        reference, position, current = (
            np.concatenate([getattr(part, name) for part in parts]) for name in ("reference", "position", "current")
        )
        return LoopRecord(first, 1.0 / self.rate, reference, position, current, self.machine.axis_names)

    def tones_at_rest(self, tones: ToneSet, axis: int, settle: float, window: float) -> LoopRecord:
        """Play tones on one axis while the rotor lies on its backup bearing; the loop stays open.

        The currents are bounded by the target itself: by SMALL, whatever the tones are.

        Parameters
        ----------
        tones : ToneSet
            Frequencies, amplitudes and phases.
        axis : int
            Index of the axis.
        settle : float
            Time that is left out at the beginning (s).
        window : float
            Duration of the record after it (s).

        Returns
        -------
        LoopRecord
            The samples of the window.

        Raises
        ------
        TargetError
            If the target trips, or telemetry is lost.
        LevitatedError
            If another host levitates the rotor.
        """
        bias = max(self.machine.axes[axis].bias_current, 0.1)
        peak = SMALL * bias
        model = generator_of(tones, axis, len(self.machine.axes), peak, self.rate)
        law = LinearControl(model, LinearControllerParameters(current_limit=1.01 * peak))
        self.configure(law, 1.01 * peak)
        self._lift(_RAMP)
        try:
            return self.record(window, self.status().step + round(settle * self.rate))
        finally:
            self.off()

    def configure(self, controller: KnownController, current: float) -> None:
        """Use this controller, with this limit on its currents (A).

        Parameters
        ----------
        controller : KnownController
            Controller of the target.
        current : float
            Limit of the control currents (A); that of the settings if it is lower.

        Raises
        ------
        LevitatedError
            If the rotor is levitated: settings are not for the loop of another host.
        """
        self._require_rest()
        limits = replace(self._settings.limits, control_current=min(current, self._settings.limits.control_current))
        self._link.configure(replace(self._settings, controller=controller, limits=limits))

    def levitate(self, seconds: float, rest: float) -> LoopRecord:
        """Levitate with the settings; samples from the command on, up to a trip.

        Parameters
        ----------
        seconds : float
            Duration of the ramp (s).
        rest : float
            So long it rests afterwards (s).

        Returns
        -------
        LoopRecord
            The loop from the command to the end of the rest, or to a trip.

        Raises
        ------
        LevitatedError
            If another host levitates the rotor.
        """
        self.configure(self._settings.controller, self._settings.limits.control_current)
        first = self._lift(seconds)
        return self.record(seconds + rest, first)

    def _lift(self, seconds: float) -> int:
        """Levitate; the step before."""
        status = self._require_rest()
        self.has_levitated = True  # also if the reply is lost
        self._link.levitate(seconds)
        return status.step

    def _require_rest(self) -> TargetStatus:
        status = self.status()
        if status.currents_on:
            raise LevitatedError
        return status

    def excite(self, samples: NDArray[np.float64]) -> LoopRecord:
        """Play an excitation (m), shape (steps, axes); its samples.

        Parameters
        ----------
        samples : ndarray, shape (steps, axes)
            Excitation (m).

        Returns
        -------
        LoopRecord
            The loop while it played.

        Raises
        ------
        TargetError
            If the target refuses it, or trips.
        """
        arm = self._link.upload(samples)
        first = self.status().step + round(0.1 * self.rate)
        arm(first)
        self._wait(first + len(samples) + 20)  # until it has ended
        return self.past(first, len(samples))

    def beyond_limits(self, samples: NDArray[np.float64]) -> str:
        """By what an excitation is beyond the limits of the settings; the target would refuse it.

        Parameters
        ----------
        samples : ndarray, shape (steps, axes)
            Excitation (m).

        Returns
        -------
        str
            Its amplitude or slew, and what is allowed; empty if both are.
        """
        try:
            require_amplitude_and_slew(samples, self._settings.limits, self.machine)
        except ExcitationError as problem:
            return str(problem)
        return ""

    @property
    def levitated(self) -> bool:
        """Whether the rotor is levitated, and has arrived."""
        return self.status().state is TargetState.LEVITATED

    def off(self) -> None:
        """All currents off, at once, if this object has levitated the rotor."""
        self.status()  # of the same boot
        if self.has_levitated:
            self._link.land(0.0)
            self.has_levitated = False

    def land(self, seconds: float) -> None:
        """Land what this object has levitated, and wait for it.

        Parameters
        ----------
        seconds : float
            Duration of the landing (s).
        """
        if self.has_levitated:
            if self.status().currents_on:
                self._link.land(seconds)
                self._wait(self.status().step + round((seconds + 0.1) * self.rate))
            self.has_levitated = self.status().currents_on

    def down(self, seconds: float) -> None:
        """Land what this object has levitated; where the target does not land it, switch the currents off at once.

        Parameters
        ----------
        seconds : float
            Duration of the landing (s).

        Raises
        ------
        TargetError
            If the target does not answer; RebootedError if it has been started anew.
        """
        try:
            self.land(seconds)
        except RebootedError:
            raise
        except TargetError:
            self.off()
        if self.has_levitated:
            self.off()
