"""The first steps of a commissioning: over a link of its own, before the bridge is connected.

Small currents on the backup bearing need another controller than that of the bridge, see `amb_core.rig.commissioning`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import TargetError
from amb_core.rig.commissioning import PUSHES, Bench, Check, Diagnosis, Expected, before_lift, levitated
from amb_core.rig.commissioning.bench import LostSamplesError
from amb_core.rig.link.layout import TargetState
from amb_core.rig.link.link import TargetDescription, TargetLink, TargetSettings
from amb_sim_node.bridge_parameters import BridgeParameters
from amb_sim_node.rig_link import controller_of, link_of

STARTING = 20.0  # s for a target that still starts
PUSHED = 0.3  # s of samples while the rotor is held
FRAME = 120  # steps: no frame of telemetry holds more
ATTEMPTS = 3  # of a measurement whose telemetry is not whole
_POLL = 0.01  # s

T = TypeVar("T")


class Wiring:
    """A rig behind a link of its own.

    Parameters
    ----------
    bridge : BridgeParameters
        Link, controller and protection.
    expected : Expected, optional
        Of the model of the machine.
    confirm : callable, optional
        Asks the user to do something; without it nobody moves the rotor by hand.
    check : callable
        Raises AmbError if a node of the graph has ended.

    Raises
    ------
    TargetError
        If the target does not answer, or the rotor is levitated.
    """

    def __init__(
        self,
        bridge: BridgeParameters,
        expected: Expected | None,
        confirm: Callable[[str], bool] | None,
        check: Callable[[], None],
    ) -> None:
        self._expected, self._confirm, self._parameters = expected, confirm, bridge
        self._link, self._bench = self._connected(check)
        if self._link.status().state not in (TargetState.OFF, TargetState.TRIPPED):
            self.close()
            raise TargetError("the rotor is levitated already; land it first")
        self._link.reset_faults()

    def _connected(self, check: Callable[[], None]) -> tuple[TargetLink, Bench]:
        until = time.monotonic() + STARTING
        while True:
            link = link_of(self._parameters.link, lambda: None)
            try:
                bench = Bench(link, self._settings, partial(self._wait, link))
            except TargetError:
                link.close()
                check()
                if time.monotonic() > until:
                    raise
            else:
                return link, bench

    def _settings(self, description: TargetDescription) -> TargetSettings:
        parameters = self._parameters
        limits = parameters.protection.lowered(description.limits, parameters.current_limit)
        return TargetSettings(controller_of(parameters), limits, parameters.landing_reference)

    def close(self) -> None:
        """Land the rotor if it is levitated, and leave the target to the bridge."""
        try:
            if self._link.status().state not in (TargetState.OFF, TargetState.TRIPPED):
                self._bench.land(self._parameters.landing_time)
        finally:
            self._link.close()

    def before_lift(self) -> list[Check]:
        """Sensors and coils while the rotor lies on its backup bearing."""
        hand = self._by_hand if self._confirm is not None else None
        return _checks(_whole(lambda: before_lift(self._bench, self._expected, hand)))

    def lift(self) -> list[Check]:
        """Lift the rotor for some seconds."""
        seconds = self._parameters.levitation_time
        findings = _whole(lambda: levitated(self._bench, self._expected, seconds, self._confirm is not None))
        return _checks(Diagnosis(findings))

    def _by_hand(self, bench: Bench) -> Mapping[str, Mapping[str, NDArray[np.float64]]]:
        assert self._confirm is not None
        pushed: dict[str, dict[str, NDArray[np.float64]]] = {}
        for bearing in bench.machine.bearings:
            for way in PUSHES:
                question = f"Push the rotor at bearing {bearing.name} towards {way}, onto its backup bearing. Held?"
                if self._confirm(question):
                    pushed.setdefault(bearing.name, {})[way] = bench.record(PUSHED).position
        return {name: ways for name, ways in pushed.items() if len(ways) == len(PUSHES)}

    @staticmethod
    def _wait(link: TargetLink, step: int) -> None:
        """Until telemetry up to this step has arrived: it comes in frames."""
        while link.status().step < step + FRAME:
            time.sleep(_POLL)
        delivered = -1
        while link.count.samples.delivered != delivered:  # what is under way has come when a reply brings no more
            delivered = link.count.samples.delivered
            time.sleep(_POLL)
            link.status()


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
