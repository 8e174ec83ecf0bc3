"""The services and messages of the region monitor as plain calls: the present region, and region maps."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from amb_bringup.client.connection import GraphConnection
from amb_bringup.client.errors import ClientError
from amb_bringup.client.request_fields import absolute, with_settings
from amb_msgs.action import BuildMap
from amb_msgs.msg import RegionState as RegionStateMessage
from amb_ros import topics
from amb_ros.qos import HISTORY
from amb_ros.subscriptions import create_subscription

if TYPE_CHECKING:
    from amb_core.regions import Region, RegionState
    from amb_core.regions.region_map import MapProgress, RegionMap


QUIET = 1.0  # s without a region message after which no other one is expected


class RegionCalls(GraphConnection):
    """Calls the node region_monitor, and listens to it."""

    _run = 0  # number of the present run
    _region: RegionStateMessage | None = None
    _region_time = -math.inf  # when it arrived, in the steady clock (s)
    _region_subscription: Any = None  # made at the first request for regions

    def use_run(self, run: int) -> None:
        """Take a later run for the present one.

        Parameters
        ----------
        run : int
            Number of the run; an earlier one than the present is ignored.
        """
        self._run = max(self._run, run)

    def region_state(self) -> RegionState:
        """The region in which the bearing runs in the present run, with its features; waits for the first one.

        While the loop stands, it also waits until the monitor has processed all steps of the run.

        Returns
        -------
        RegionState
            The latest state that the region monitor has published.
        """
        self._listen_to_regions()
        self.process_arrived()
        began = time.monotonic()

        def is_latest() -> bool:
            region, reached, now = self._region, self._reached_step(), time.monotonic()
            if region is None or self._run not in (0, region.run):  # 0: nobody reports a run
                return False
            if reached is not None and region.next_step >= reached:
                return True
            return now > max(began, self._region_time) + QUIET or now > began + 0.5 * self.timeout

        self.wait_until(
            is_latest, complaint="no region of the present run received; has it run, and is region_monitor running?"
        )
        return self._region_state()

    def _reached_step(self) -> int | None:
        """The step that the loop has reached in the present run, None where nobody reports it."""
        return None

    def wait_for_region(self, region: Region, timeout: float | None = None) -> RegionState:
        """Wait until the rotor is in a region in the present run.

        Parameters
        ----------
        region : Region
            The region; A says nothing of the regions that `not_judged` of the state names.
        timeout : float, optional
            Longest wait (s); that of the connection by default.

        Returns
        -------
        RegionState
            The state in which the region was reached.
        """
        self._listen_to_regions()

        def reached() -> bool:
            return self._region is not None and (self._region.run, self._region.region) == (self._run, region)

        self.wait_until(reached, timeout, f"the rotor did not enter region {region.name}")
        return self._region_state()

    def _region_state(self) -> RegionState:
        from amb_core.recording.messages.region_state import region_state_from_message  # takes half a second to import

        return region_state_from_message(self._region)

    def build_map(
        self,
        parameter_file: str | Path = "",
        path: str | Path = "",
        progress: Callable[[MapProgress], None] | None = None,
        cancelled: Callable[[], bool] | None = None,
        **settings: Any,
    ) -> RegionMap:
        """Build a region map, by default that of the running loop.

        Parameters
        ----------
        parameter_file : str or Path, optional
            ROS parameter file with another plant and controller.
        path : str or Path, optional
            File for the map.
        progress : callable, optional
            Called with a `MapProgress` whenever a sweep has finished. None for no calls.
        cancelled : callable, optional
            Called while waiting; when it returns true the goal is cancelled. Finished sweeps stay in the cache. None if
            it cannot be cancelled.
        **settings : object
            As in `amb_core.regions.region_map.MapSettings`, SI units; missing ones take their defaults.

        Returns
        -------
        RegionMap
            Not `complete` if `max_sweeps` are done before all boundaries are resolved, or, with the finished sweeps,
            after a cancellation.

        Raises
        ------
        ClientError
            If the monitor is missing, refuses, or the map fails.
        """
        from amb_core.recording.messages.region_map import region_map_from_message
        from amb_core.regions.region_map import MapProgress

        def on_feedback(message: Any) -> None:
            feedback = message.feedback
            if progress is not None:
                region_map = region_map_from_message(feedback.map) if feedback.map.amplitude else None
                progress(MapProgress(feedback.done, feedback.total, feedback.reused, region_map))

        own = {"parameter_file": absolute(parameter_file), "path": absolute(path)}
        result = self.act(
            BuildMap,
            "region_monitor/build_map",
            on_feedback=on_feedback,
            cancelled=cancelled or (lambda: False),
            **with_settings(BuildMap.Goal, own, settings),
        )
        if not result.map.amplitude:
            raise ClientError(result.message)
        return region_map_from_message(result.map)

    def heard_region(self) -> RegionStateMessage | None:
        """The last region state of the present run, without waiting; None before the first one.

        Returns
        -------
        RegionStateMessage or None
            The message of the region monitor.
        """
        self._listen_to_regions()
        return self._region if self._region is not None and self._region.run == self._run else None

    def _listen_to_regions(self) -> None:
        self.require_open()
        if self._region_subscription is None:
            self._region_subscription = create_subscription(
                self.node, RegionStateMessage, topics.REGION, self._on_region, HISTORY
            )

    def _on_region(self, message: RegionStateMessage) -> None:
        self._region, self._region_time = message, time.monotonic()
