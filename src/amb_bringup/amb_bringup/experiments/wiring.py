"""The first steps of a commissioning: over a link of its own, before the bridge is connected.

Small currents on the backup bearing need another controller than that of the bridge, see `amb_core.rig.commissioning`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import TargetError
from amb_core.rig.commissioning import (
    PUSHES,
    Bench,
    Check,
    CommissioningSettings,
    Diagnosis,
    Expected,
    before_lift,
    levitated,
)
from amb_core.rig.commissioning.bench import LostSamplesError
from amb_core.rig.link.link import LevitatedError, TargetDescription, TargetLink, TargetSettings
from amb_sim_node.bridge_parameters import BridgeParameters
from amb_sim_node.rig_link import controller_of, link_of

STARTING = 20.0  # s for a target that still starts
PUSHED = 0.3  # s of samples while the rotor is held
LATE = 1.0  # s after which samples that have not come were lost
ATTEMPTS = 3  # of a measurement whose telemetry is not whole
_POLL = 0.01  # s

T = TypeVar("T")


class Wiring:
    """A rig behind a link of its own.

    Parameters
    ----------
    bridge : BridgeParameters
        Link, controller and protection.
    settings : CommissioningSettings
        Limits of noise and place of the resting rotor.
    expected : Expected, optional
        Of the model of the machine.
    confirm : callable, optional
        Asks the user to do something; without it nobody moves the rotor by hand.
    check : callable
        Raises AmbError if a node of the graph has ended.

    Raises
    ------
    TargetError
        If the target does not answer; LevitatedError if the rotor is levitated: it is left as it is.

    Attributes
    ----------
    bench : Bench
        The target behind that link.
    """

    def __init__(
        self,
        bridge: BridgeParameters,
        settings: CommissioningSettings,
        expected: Expected | None,
        confirm: Callable[[str], bool] | None,
        check: Callable[[], None],
    ) -> None:
        self._expected, self._confirm, self._parameters, self._limits = expected, confirm, bridge, settings
        self._link, self.bench = _connected(bridge, self._wait, check)
        try:
            if self.bench.status().currents_on:
                raise LevitatedError
            self._link.reset_faults()
        except BaseException:
            self._link.close()
            raise

    def close(self) -> str:
        """Land the rotor if this object has levitated it, and leave the target to the bridge.

        Returns
        -------
        str
            Why currents may flow nevertheless; empty if the target says that they are off.
        """
        try:
            self.bench.land(self._parameters.landing_time)
            status = self.bench.status()
            return f"the target is {status.state.name.lower()}" if status.currents_on else ""
        except TargetError as problem:
            return str(problem)
        finally:
            self._link.close()

    def before_lift(self) -> list[Check]:
        """Sensors and coils while the rotor lies on its backup bearing."""
        hand = self._by_hand if self._confirm is not None else None
        return _checks(_whole(lambda: before_lift(self.bench, self._expected, hand, self._limits)))

    def lift(self) -> list[Check]:
        """Lift the rotor for some seconds."""
        seconds = self._parameters.levitation_time

        def lifted() -> Diagnosis:
            result = Diagnosis(levitated=True)
            result.findings += levitated(
                self.bench, self._expected, seconds, self._confirm is not None, result.unchecked
            )
            return result

        return _checks(_whole(lifted))

    def _by_hand(self, bench: Bench) -> Mapping[str, Mapping[str, NDArray[np.float64]]]:
        assert self._confirm is not None
        pushed: dict[str, dict[str, NDArray[np.float64]]] = {}
        for bearing in bench.machine.bearings:
            for way in PUSHES:
                question = f"Push the rotor at bearing {bearing.name} towards {way}, onto its backup bearing. Held?"
                if self._confirm(question):
                    pushed.setdefault(bearing.name, {})[way] = bench.record(PUSHED).position
        return {name: ways for name, ways in pushed.items() if len(ways) == len(PUSHES)}

    def _wait(self, step: int) -> None:
        """Until telemetry up to this step has arrived, or the target has been past it for long: it was lost."""
        late = step + LATE * self.bench.rate
        while self.bench.reached < step and self.bench.status().step < late:
            time.sleep(_POLL)


def require_rest(bridge: BridgeParameters, check: Callable[[], None]) -> None:
    """Refuse a rotor that is levitated, before the bridge takes its telemetry away from the host that levitates it.

    Nothing that changes the target is sent.

    Parameters
    ----------
    bridge : BridgeParameters
        Link, controller and protection.
    check : callable
        Raises AmbError if a node of the graph has ended.

    Raises
    ------
    TargetError
        If the target does not answer; LevitatedError if the rotor is levitated: it is left as it is.
    """
    link, bench = _connected(bridge, lambda _step: None, check)
    try:
        if bench.status().currents_on:
            raise LevitatedError
    finally:
        link.close()


def _connected(
    bridge: BridgeParameters, wait: Callable[[int], None], check: Callable[[], None]
) -> tuple[TargetLink, Bench]:
    """A link that takes over no levitated rotor, and the target behind it, which may still start."""

    def settings(description: TargetDescription) -> TargetSettings:
        limits = bridge.protection.lowered(description.limits, bridge.current_limit)
        return TargetSettings(controller_of(bridge), limits, bridge.landing_reference)

    until = time.monotonic() + STARTING
    while True:
        link = link_of(bridge.link, lambda: None, take_over=False)
        try:
            bench = Bench(link, settings, wait)
        except LevitatedError:
            link.close()
            raise
        except TargetError:
            link.close()
            check()
            if time.monotonic() > until:
                raise
        else:
            return link, bench


def _whole(measure: Callable[[], T]) -> T:
    """What a measurement returns; it is repeated if some of its telemetry has been lost."""
    for _ in range(ATTEMPTS - 1):
        try:
            return measure()
        except LostSamplesError:
            continue
    return measure()


def _checks(diagnosis: Diagnosis) -> list[Check]:
    checks = [
        Check(one.fault + (f" of {' and '.join(one.axes)}" if one.axes else ""), one.detail, limit="none", passed=False)
        for one in diagnosis.findings
    ]
    if not checks:
        checks.append(Check("faults of sensors and coils", "none", limit="none", passed=True))
    return checks + [Check("not checked", text) for text in diagnosis.unchecked]
