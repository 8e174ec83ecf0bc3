"""Waits of the bridge for its target, by the target's own clock, which is slow on a busy host if it is emulated."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from amb_core.ground.errors import TargetError
from amb_core.rig.link import TargetLink, TargetState, TargetStatus
from amb_sim_node.rig_watch import RigWatch

STANDS_STILL = "the target answers, but makes no control steps: nothing holds the rotor; switch the amplifiers off"
PATIENCE = 5.0  # s in addition to its duration for a levitation or a landing
PERIOD = 0.01  # s between two questions


class RigWaits:
    """Waits in the worker of the bridge, while it is configured.

    Parameters
    ----------
    watch : RigWatch
        What is known of the rig.
    link : callable
        Returns the link.

    Raises
    ------
    TargetError
        By every wait: if the target does not answer, makes no control steps, or takes much longer than it should.
    """

    def __init__(self, watch: RigWatch, link: Callable[[], TargetLink]) -> None:
        self._watch, self._link = watch, link

    def for_state(
        self, states: Sequence[TargetState], duration: float, require: Callable[[], None] = lambda: None
    ) -> None:
        """Wait until the target is in one of some states, as long as what is required holds; not if it trips instead.

        Parameters
        ----------
        states : sequence of TargetState
            Those awaited.
        duration : float
            How long it should take (s).
        require : callable, optional
            Raises an error if the wait is to end.
        """
        late = self._deadline(duration + PATIENCE)
        while (status := self._link().status()).state not in states:
            if status.state is TargetState.TRIPPED:
                raise TargetError(self._watch.latched() or "the target has tripped")
            require()
            if late(status):
                raise TargetError(f"the target is still {status.state.name.lower()} after {duration + PATIENCE:g} s")
            time.sleep(PERIOD)

    def for_run(self, require: Callable[[], None]) -> None:
        """Wait until telemetry of the levitated rotor arrives: the run has begun.

        Parameters
        ----------
        require : callable
            Raises an error if the wait is to end.
        """
        late = self._deadline(PATIENCE)
        while (runs := self._watch.runs) is None or not runs.levitated:
            require()
            if late(self._link().status()):
                raise TargetError(f"the rotor is levitated, but no telemetry arrives within {PATIENCE:g} s")
            time.sleep(PERIOD)

    def _deadline(self, duration: float) -> Callable[[TargetStatus], bool]:
        """Whether a time (s) has passed by the clock of the target; TargetError if that clock stands still."""
        assert self._watch.machine is not None  # since it is configured
        steps, first = duration * self._watch.machine.sample_rate, self._link().status().step

        def passed(status: TargetStatus) -> bool:
            if self._watch.standing:
                raise TargetError(STANDS_STILL)
            return not first <= status.step <= first + steps  # a reboot begins anew

        return passed
