"""What every link does alike that commands a target by the frames of AMB-UDP, however they travel."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import TargetError
from amb_core.rig.link import commands
from amb_core.rig.link.answers import Reply, TargetStatus, TelemetryBlock
from amb_core.rig.link.commands import Command
from amb_core.rig.link.link import TargetLink
from amb_core.rig.link.upload import Upload, excitation_upload


class CommandedLink(TargetLink):
    """A link whose commands are frames of AMB-UDP; a subclass brings them to the target."""

    _uploads: Iterator[int]  # numbers of uploads

    @abstractmethod
    def _command(self, command: Command) -> Reply:
        """The reply to a command that the target has carried out; TargetError if it refuses."""

    @abstractmethod
    def _bring(self, upload: Upload, cancelled: Callable[[], bool]) -> None:
        """Bring an upload to the target, whole."""

    def levitate(self, seconds: float) -> None:
        """Close the loop, and move the reference to the nominal one within this time (s)."""
        self._command(commands.levitate(seconds))

    def land(self, seconds: float) -> None:
        """Land within this time.

        Parameters
        ----------
        seconds : float
            Duration of the landing (s).
        """
        self._command(commands.delevitate(seconds))

    def upload(
        self, samples: NDArray[np.float64], cancelled: Callable[[], bool] = lambda: False
    ) -> Callable[[int], None]:
        """Bring an excitation to the target; returns what arms it.

        Parameters
        ----------
        samples : ndarray, shape (steps, axes)
            Excitation (m).
        cancelled : callable, optional
            Returns whether to give the upload up; never by default.

        Returns
        -------
        callable
            Arms the excitation at a step of the target.
        """
        upload = excitation_upload(next(self._uploads), samples)
        self._bring(upload, cancelled)

        def arm(step: int) -> None:
            self._command(commands.arm(upload.id, step))

        return arm

    def disarm(self) -> None:
        """Stop the excitation."""
        self._command(commands.disarm())

    def trip_record(self) -> list[TelemetryBlock]:
        """What the target keeps of the second before its first trip.

        Returns
        -------
        list of TelemetryBlock
            Consecutive blocks with status words, in the order of their steps.

        Raises
        ------
        TargetError
            If it is not reached any more, or sends another record meanwhile; NoRecordError if it keeps nothing.
        """
        blocks: list[TelemetryBlock] = []
        read, rows = 0, -1
        while rows < 0 or read < rows:
            part = self._command(commands.record(read)).record
            if part is None:  # a repeated reply has no rows
                continue
            goes_on = not blocks or part.samples.first_step == blocks[-1].first_step + blocks[-1].steps
            if (rows >= 0 and part.rows != rows) or not goes_on or (part.rows > read and not part.samples.steps):
                raise TargetError("the target keeps another second than at first: it has tripped again")
            rows, read = part.rows, read + part.samples.steps
            blocks.append(part.samples)
        return blocks

    def forget_trip_record(self) -> None:
        """Let the target keep the second before its next trip."""
        self._command(commands.forget_record())

    def status(self) -> TargetStatus:
        """The state of the target now.

        Returns
        -------
        TargetStatus
            State, trips and counts of the target.
        """
        return self._command(commands.heartbeat()).status
