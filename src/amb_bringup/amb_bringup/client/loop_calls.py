"""The services of the loop as plain calls: the simulator or the rig, its excitation and its recordings."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from amb_bringup.client.errors import ClientError, NoAnswerError
from amb_bringup.client.identifier_calls import IdentifierCalls
from amb_bringup.client.region_calls import RegionCalls
from amb_bringup.client.request_fields import absolute, with_settings
from amb_bringup.client.rig import Rig
from amb_core.ground.files.parameter_files import BRIDGE_NODE, NODES
from amb_core.ground.given_values import whole_number
from amb_msgs.msg import SimulatorState
from amb_msgs.srv import (
    Pause,
    PreviewExcitation,
    Reset,
    RunSteps,
    StartExcitation,
    StartRecording,
    StopExcitation,
    StopRecording,
)
from amb_ros import topics
from amb_ros.qos import LATCHED
from amb_ros.requests import COMPUTED, QUICKLY
from amb_ros.subscriptions import create_subscription

TIMEOUT = 20.0  # s, for everything else
LONGEST_STOP = 3600.0  # s, of the service to stop a recording
EXCITATION_TIMEOUT = 120.0  # s; generator and controller may have to search for the phases of a long multisine


@dataclass(frozen=True)
class RunEnd:
    """Where a run request ended.

    Attributes
    ----------
    run : int
        Number of the run.
    step : int
        Next step.
    delevitated : bool
        Whether the rotor delevitated before that step.
    """

    run: int
    step: int
    delevitated: bool


@dataclass(frozen=True)
class StartedExcitation:
    """An accepted excitation.

    Attributes
    ----------
    run : int
        Number of its run.
    first_step : int
        Its first step.
    steps : int
        Its number of steps.
    """

    run: int
    first_step: int
    steps: int


class LoopCalls(IdentifierCalls, RegionCalls):
    """The services of the loop, of a simulator or a rig; see `GraphConnection` for errors and further methods.

    Parameters
    ----------
    namespace : str, optional
        Namespace of the nodes.
    timeout : float, optional
        Longest wall-clock wait for a node to appear, to answer or, while running, to advance (s).
    domain_id : int, optional
        DDS domain of the graph, 0 to 232; ROS_DOMAIN_ID by default.
    nodes : sequence of str, optional
        The nodes of the graph, relative to the namespace; by default those of a simulation.
    """

    def __init__(
        self,
        namespace: str = topics.NAMESPACE,
        timeout: float = TIMEOUT,
        domain_id: int | None = None,
        nodes: Sequence[str] = NODES,
    ) -> None:
        super().__init__(namespace, timeout, domain_id, nodes)
        self._state: SimulatorState | None = None
        create_subscription(self.node, SimulatorState, topics.SIMULATOR_STATE, self._on_state, LATCHED)

    @cached_property
    def rig(self) -> Rig:
        """The rig behind a hardware bridge, in a graph that has one instead of simulator and controller."""
        return Rig(self)

    # -- simulator

    @property
    def simulator_state(self) -> SimulatorState | None:
        """The last state of the simulator that a call has processed, None before the first.

        After a time without calls, `process_arrived` comes first.
        """
        return self._state

    def reset(self, parameter_file: str | Path | None = None) -> int:
        """Back to step 0 of a new run, paused.

        Parameters
        ----------
        parameter_file : str or Path, optional
            ROS parameter file for the simulator, which then behaves as if it had been started with it. Relative to the
            working directory of the caller; the simulator must be able to read it. None to keep the parameters.

        Returns
        -------
        int
            Number of the run.
        """
        self._require_simulator("simulator/reset")
        self._run = self.call(Reset, "simulator/reset", parameter_file=absolute(parameter_file or "")).run
        return self._run

    def pause(self) -> int:
        """Pause the simulator.

        Returns
        -------
        int
            The next step.
        """
        self._require_simulator("simulator/pause")
        return self.call(Pause, "simulator/pause", repeat_after=QUICKLY).step

    def run(self, steps: int, progress: Callable[[int], None] | None = None) -> RunEnd:
        """Run a number of steps and wait for the end.

        Parameters
        ----------
        steps : int
            Number of controller steps, at least 1.
        progress : callable, optional
            Called with the next step whenever the simulator reports its state. None for no calls.

        Returns
        -------
        RunEnd
            Where the run request ended.

        Raises
        ------
        ClientError
            If `steps` is below 1, the plant fails, the simulator is paused before the end or does not advance, or a
            reset or a restart of the simulator ends the run.
        """
        if whole_number("steps", steps, ClientError) < 1:
            raise ClientError(f"steps = {steps} is not allowed; allowed: 1 or more")
        with self.alone():
            self._require_simulator("simulator/run")
            return self._end_of(self.call(RunSteps, "simulator/run", steps=steps), progress)

    def _end_of(self, started: RunSteps.Response, progress: Callable[[int], None] | None) -> RunEnd:
        """Wait for the end of a run request; parameters and errors as for `run`."""
        seen_step, deadline = -1, time.monotonic() + self.timeout
        while True:
            state = self._state
            if state is not None and state.run > started.run:
                raise ClientError(
                    f"run {started.run} was ended by a reset or a restart of the simulator; the present run is "
                    f"{state.run}"
                )
            if state is not None and state.run == started.run:
                if state.step != seen_step:
                    seen_step, deadline = state.step, time.monotonic() + self.timeout
                    if progress is not None:
                        progress(state.step)
                if state.mode == SimulatorState.FAULT:
                    raise ClientError(
                        f"the plant failed at step {state.step}; see /diagnostics and the simulator's log"
                    )
                if state.mode == SimulatorState.DELEVITATED or state.step >= started.last_step:
                    return RunEnd(state.run, state.step, state.mode == SimulatorState.DELEVITATED)
                if state.mode == SimulatorState.PAUSED and state.step > started.first_step:
                    raise ClientError(f"the simulator was paused at step {state.step}, before {started.last_step}")
            if time.monotonic() > deadline:
                raise ClientError(self._standstill(started.run))
            self.spin_once()

    def _standstill(self, run: int) -> str:
        """Why a run does not go on, by the last state of the simulator."""
        state, wait = self._state, f"{self.timeout:g} s"
        if state is None or state.run != run:
            return f"no state of run {run} within {wait}; is the simulator running?"
        if state.mode == SimulatorState.WAITING:
            return (
                f"the loop has stood at step {state.step} for {wait}: the simulator waited for the controller when "
                "it was last heard; are both running?"
            )
        if state.mode == SimulatorState.PAUSED:
            return f"the simulator has been paused at step {state.step} for {wait}"
        return f"no state after step {state.step} of run {run} within {wait}; is the simulator running?"

    def _require_simulator(self, name: str) -> None:
        """Wait for a service of the simulator; ClientError if the graph has a bridge to a rig instead."""
        self.require_open()
        service = self.node.resolve_service_name(name)

        def is_there() -> bool:
            if self.node.count_services(service) > 0:  # whether or not the graph knows the name of its node
                return True
            names = self.node_names()
            if BRIDGE_NODE in names and "simulator" not in names:
                raise ClientError(
                    f"{service} needs a simulator; this graph has a rig behind {BRIDGE_NODE}: levitate and land it, "
                    "with AmbClient.rig or `amb rig`"
                )
            return False

        self.wait_until(is_there, complaint=f"no service {service}; is the node running?")

    # -- excitation

    def start_excitation(self, kind: str, first_step: int = -1, **settings: Any) -> StartedExcitation:
        """Start an excitation in the present run.

        Parameters
        ----------
        kind : str
            One of `amb_core.excitation.KINDS`.
        first_step : int, optional
            First step of the excitation; -1 for the next step.
        **settings : object
            Fields of the kind in SI units, as in the service: amplitude, axes, duration, frequency, ...

        Returns
        -------
        StartedExcitation
            Run, first step and number of steps.
        """
        own = {"kind": kind, "first_step": first_step, "run": self._run}
        fields = with_settings(StartExcitation.Request, own, settings)
        wait = max(self.timeout, EXCITATION_TIMEOUT)
        try:
            answer = self.call(StartExcitation, "excitation_generator/start", timeout=wait, **fields)
        except NoAnswerError:  # it may play, at a step that nobody knows
            with contextlib.suppress(ClientError):
                self.stop_excitation()
            raise
        return StartedExcitation(answer.run, answer.first_step, answer.steps)

    def stop_excitation(self) -> None:
        """Stop the excitation: the reference returns to nominal."""
        self.call(StopExcitation, "excitation_generator/stop", repeat_after=QUICKLY)

    def preview_excitation(self, kind: str, region_map: str | Path = "", **settings: Any) -> PreviewExcitation.Response:
        """Predict in which regions of a map an excitation would run, without starting it.

        Parameters
        ----------
        kind : str
            As for `start_excitation`, with the same settings.
        region_map : str or Path, optional
            File of a map; by default the last one that the region monitor has built.
        **settings : object
            As for `start_excitation`.

        Returns
        -------
        PreviewExcitation.Response
            Its fields are described in `amb_msgs/srv/PreviewExcitation`.
        """
        own = {"kind": kind, "map": absolute(region_map)}
        fields = with_settings(PreviewExcitation.Request, own, settings)
        return self.call(PreviewExcitation, "excitation_generator/preview", repeat_after=COMPUTED, **fields)

    # -- recording

    def start_recording(self, uri: str | Path = "") -> str:
        """Start a bag.

        First waits for all nodes of the graph, so that no message is missing from the bag.

        Parameters
        ----------
        uri : str or Path, optional
            New folder, relative to the working directory of the caller; empty for one named by date, in the recorder's
            directory.

        Returns
        -------
        str
            Path of the bag.
        """
        self.wait_for_nodes()
        return self.call(StartRecording, "recorder/start", uri=absolute(uri)).uri

    def stop_recording(self, run: int = 0, step: int = 0) -> str:
        """Close the bag once its telemetry has arrived, for which the recorder waits half the client's timeout.

        Parameters
        ----------
        run : int, optional
            Run of the awaited step; 0 for the current one.
        step : int, optional
            First step that need not be in the bag; 0 for that at which the simulator stands.

        Returns
        -------
        str
            Path of the bag.
        """
        # The other half is for the recorder to close the bag, and to report what is missing.
        wait = {"timeout": min(0.5 * self.timeout, LONGEST_STOP)}
        return self.call(StopRecording, "recorder/stop", wait, wait_for_run=run, wait_for_step=step).uri

    # -- messages

    def _reached_step(self) -> int | None:
        state = self._state
        if state is None and BRIDGE_NODE in self.node_names():
            state = self.rig.state
        return int(state.step) if state is not None and state.run == self._run else None

    def _on_state(self, message: SimulatorState) -> None:
        self._state = message
        self.use_run(message.run)
