"""Measurements on a levitated rig: an excitation at rest, and its samples without a gap."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from amb_bringup.client import AmbClient, StartedExcitation
from amb_bringup.client.live_telemetry import LiveTelemetry
from amb_core.excitation import Excitation
from amb_core.excitation.axes import parts_of
from amb_core.ground.errors import BagError
from amb_core.loop.machine import Machine
from amb_core.loop.records import LoopRecord
from amb_core.regions import Region
from amb_core.rig.commissioning import Check

T = TypeVar("T")

SETTLING = 0.3  # s before and after an excitation
ATTEMPTS = 3  # of a measurement whose telemetry is not whole


class Measurements:
    """Excites the rotor of a rig and returns what its telemetry shows.

    Parameters
    ----------
    amb : AmbClient
        In the graph of the rig.
    machine_of : callable
        Returns the machine of the target.

    Attributes
    ----------
    run : int
        The present run, set by whoever levitates; 0 while the rotor is not levitated.
    """

    def __init__(self, amb: AmbClient, machine_of: Callable[[], Machine]) -> None:
        self._amb, self._machine_of = amb, machine_of
        self._telemetry = LiveTelemetry(amb)
        self.run = 0

    def steps(self, seconds: float) -> int:
        """Number of steps in a time (s)."""
        return round(seconds * self._machine_of().sample_rate)

    def samples(self, first: int, stop: int) -> LoopRecord:
        """Samples of the present run.

        Raises
        ------
        BagError
            If some of them were lost.
        """
        return self._telemetry.record(self.run, first, stop)

    def excite(self, excitation: Excitation) -> StartedExcitation:
        """Apply an excitation after a moment of rest, and wait until the rotor rests again.

        It is repeated if telemetry is lost in between.
        """
        return whole(lambda: self._excite_once(excitation))

    def _excite_once(self, excitation: Excitation) -> StartedExcitation:
        rig, rest = self._amb.rig, self.steps(SETTLING)
        rig.wait_for_step(int(rig.wait_for_state().step) + 2 * rest)
        started = self._amb.start_excitation(excitation.kind, **excitation.model_dump())
        stop = started.first_step + started.steps + rest
        rig.wait_for_step(stop)
        self.samples(started.first_step - rest, stop)
        return started

    def record(self, started: StartedExcitation) -> LoopRecord:
        """The samples of an excitation."""
        return self.samples(started.first_step, started.first_step + started.steps)

    def rest_before(self, started: StartedExcitation) -> LoopRecord:
        """The samples of the rest before it."""
        return self.samples(started.first_step - self.steps(SETTLING), started.first_step)

    def of_each_axis(
        self, excitation: Excitation, started: StartedExcitation, before: int = 0, after: int = 0
    ) -> list[LoopRecord]:
        """The samples while each axis in turn is excited, with some steps before and after."""
        first = started.first_step
        return [
            self.samples(first + part.first - before, first + part.stop + after)
            for part in parts_of(excitation.axes, started.steps, self._machine_of())
        ]

    def region(self, started: StartedExcitation) -> Check:
        """Whether the rotor stayed in region A during an excitation."""
        stop = started.first_step + started.steps
        region = Region(self._telemetry.highest_region(self.run, started.first_step, stop))
        return Check("highest region", region.name, limit="A", passed=region is Region.A, advice="lower the amplitude")


def whole(measure: Callable[[], T]) -> T:
    """What a measurement returns; it is repeated if some of its telemetry has been lost."""
    for _ in range(ATTEMPTS - 1):
        try:
            return measure()
        except BagError:
            continue
    return measure()
