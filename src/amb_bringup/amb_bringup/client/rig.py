"""A rig through a client: the life cycle of the bridge, its state and trips as plain calls.

with AmbClient(nodes=RIG_NODES) as amb:
    amb.rig.connect()
    amb.rig.levitate()
    amb.start_excitation("multisine", amplitude=3e-6, duration=5.0)
    amb.rig.wait_for_steps(60_000)
    amb.rig.land()
"""

from __future__ import annotations

import time
from collections.abc import Callable

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from std_srvs.srv import Trigger

from amb_bringup.client.connection import UNKNOWN
from amb_bringup.client.errors import ClientError, RefusalError
from amb_bringup.client.region_calls import RegionCalls
from amb_msgs.msg import BridgeState, Trip
from amb_ros import topics
from amb_ros.qos import EVERY_STATE, LATCHED
from amb_ros.requests import QUICKLY, PendingRequest
from amb_ros.subscriptions import create_subscription

BRIDGE = "hardware_bridge"
TRANSITION_TIMEOUT = 150.0  # s: the longest levitation or landing, and what the bridge waits in addition
REASON_TIMEOUT = 1.0  # s; the bridge publishes its state ten times a second
MODES = {
    getattr(BridgeState, name): name.lower()
    for name in ("OFF", "LEVITATING", "LEVITATED", "LANDING", "TRIPPED", "UNREACHABLE")
}
_ALLOWED_FROM = {"configure": "unconfigured", "activate": "inactive", "cleanup": "inactive"}
"""From where the bridge takes a request. One to land is never held back here: it ends a levitation, too."""


class Rig:
    """The bridge of a graph.

    Parameters
    ----------
    client : RegionCalls
        In the graph of the bridge.

    Attributes
    ----------
    state : BridgeState or None
        The last state of the bridge that a call has processed, None before the first; `wait_for_state` gives the
        present one.
    trips : list of Trip
        All trips since this object was made, and those before as far as the bridge still offers them; like `state`, as
        of the last call.

    Raises
    ------
    ClientError
        By every method, if the bridge is missing, does not answer, or refuses.
    """

    def __init__(self, client: RegionCalls) -> None:
        self._client = client
        self.state: BridgeState | None = None
        self.trips: list[Trip] = []
        self._asked_to_levitate = False  # and not landed since
        create_subscription(client.node, BridgeState, topics.BRIDGE_STATE, self._on_state, LATCHED)
        create_subscription(client.node, Trip, topics.TRIP, self.trips.append, EVERY_STATE)
        self._change = client.node.create_client(ChangeState, f"{BRIDGE}/change_state")
        self._get = client.node.create_client(GetState, f"{BRIDGE}/get_state")

    def connect(self, patience: float = 30.0) -> None:
        """Connect to the target (transition `configure`); waits up to `patience` (s) for one that still starts."""
        until = time.monotonic() + patience
        while True:
            try:
                self._transition("configure")
                return
            except ClientError as problem:
                if "no answer" not in str(problem) or time.monotonic() > until:
                    raise

    def levitate(self) -> int:
        """Levitate the rotor (transition `activate`). Returns the run that begins with it."""
        self._transition("activate")
        self._client.wait_until(lambda: self._levitated() is not None, complaint="no state of a levitated rotor")
        state = self._levitated()
        assert state is not None
        return int(state.run)

    def land(self) -> None:
        """Land the rotor, also one that is being levitated (transition `deactivate`)."""
        self._transition("deactivate")
        self._asked_to_levitate = False

    def bring_down(self) -> None:
        """Land a rotor that this bridge or a request of this client has levitated, or still may.

        While the bridge is inactive, a request to levitate may wait in it, or the rotor be one that it could not land.
        A rotor that another host levitates is left as it is.
        """
        if not (self._asked_to_levitate or self.is_up()):
            return
        try:
            self.land()
        except RefusalError:
            if self.wait_for_state().mode not in (BridgeState.OFF, BridgeState.TRIPPED):
                raise
            self._asked_to_levitate = False

    def off(self) -> None:
        """Switch the currents off at once, in whatever state bridge and target are: the rotor falls."""
        self._client.call(Trigger, f"{BRIDGE}/off", repeat_after=QUICKLY)

    def disconnect(self) -> None:
        """Leave the target (transition `cleanup`)."""
        self._transition("cleanup")

    def reset_faults(self) -> None:
        """Forget latched trips."""
        self._client.call(Trigger, f"{BRIDGE}/reset_faults", repeat_after=QUICKLY)

    def life_cycle(self) -> str:
        """State in the life cycle: unconfigured, inactive, active or finalized, or that of a transition."""
        self._client.wait_until(self._get.service_is_ready, complaint=f"no node {BRIDGE}; is it running?")
        pending = PendingRequest(self._get, GetState.Request(), QUICKLY)
        try:
            self._client.wait_until(
                lambda: pending.answer() is not None, complaint=f"no answer from {BRIDGE}/get_state"
            )
            return str(pending.answer().current_state.label)
        finally:
            pending.forget()

    def is_up(self) -> bool:
        """Whether there is a rotor to land: the bridge is active, or on the way to it."""
        return self.life_cycle() in ("activating", "active")

    def wait_for_state(self) -> BridgeState:
        """The latest state of the bridge, however long nothing was called; waits for the first one."""
        self._client.process_arrived()
        self._client.wait_until(lambda: self.state is not None, complaint=f"no state of {BRIDGE}; is it running?")
        assert self.state is not None
        return self.state

    def wait_for_step(self, step: int, progress: Callable[[int], None] | None = None) -> None:
        """Wait until the telemetry of the present run has reached a step.

        Raises
        ------
        ClientError
            If the run ends before, with the reason, or telemetry stands still for longer than the client's timeout.
        """
        with self._client.alone():
            self._wait_for_step(step, progress)

    def _wait_for_step(self, step: int, progress: Callable[[int], None] | None) -> None:
        first = self.wait_for_state()
        seen, deadline = -1, time.monotonic() + self._client.timeout
        while (state := self.wait_for_state()).step < step:
            if state.run != first.run or state.mode in (BridgeState.OFF, BridgeState.TRIPPED):
                raise ClientError(f"the run ended at step {state.step}, before {step}: {self._why(state)}")
            if state.step != seen:
                seen, deadline = state.step, time.monotonic() + self._client.timeout
                if progress is not None:
                    progress(int(state.step))
            if time.monotonic() > deadline:
                raise ClientError(f"telemetry has stood at step {seen} for {self._client.timeout:g} s")
            self._client.spin_once()

    def _why(self, state: BridgeState) -> str:
        return state.problem or f"the target is {MODES[state.mode]}"

    def _levitated(self) -> BridgeState | None:
        """The latest state, if it is of a levitated rotor."""
        state = self.state
        return state if state is not None and state.mode == BridgeState.LEVITATED and state.run else None

    def _transition(self, label: str) -> None:
        if label in _ALLOWED_FROM and (present := self.life_cycle()) != _ALLOWED_FROM[label]:
            raise ClientError(f"{BRIDGE} is {present}; {label} is allowed while it is {_ALLOWED_FROM[label]}")
        self._client.wait_until(self._change.service_is_ready, complaint=f"no node {BRIDGE}; is it running?")
        before = self.state.sequence if self.state is not None else 0
        if label == "activate":
            self._asked_to_levitate = True  # before it is sent: Ctrl-C may come at any time
        answer = self._change.call_async(ChangeState.Request(transition=Transition(label=label)))
        self._client.wait_until(answer.done, TRANSITION_TIMEOUT, f"no answer from {BRIDGE}/change_state{UNKNOWN}")
        if answer.result().success:
            return
        self._client.wait_until(
            lambda: (
                self.state is not None
                and self.state.sequence > before
                and any(text in self.state.problem for text in (f"{label}: ", f"{label} is not allowed"))
            ),
            REASON_TIMEOUT,
            f"{BRIDGE}: {label} failed; see its log",
        )
        assert self.state is not None
        problem = self.state.problem  # the one just found, not a later one
        kind = RefusalError if f"{label} is not allowed" in problem else ClientError
        raise kind(f"{BRIDGE}: {problem}")

    def _on_state(self, message: BridgeState) -> None:
        self.state = message
        if message.run:
            self._client.use_run(int(message.run))
