"""A link of one's own whose calls fail, wait or lie as long as files beside this module say so; `calls` logs them.

Installed beside the link of docs/how-to/connect-a-rig.md in a folder of the test, and loaded by the bridge.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

from vendor_link import VendorLink  # type: ignore[import-not-found]

from amb_core.ground.errors import TargetError
from amb_core.rig.link import TargetState

FOLDER = Path(__file__).parent


def wrong(name: str) -> bool:
    return (FOLDER / name).exists()


def log(text: str) -> None:
    with (FOLDER / "calls").open("a") as file:
        file.write(f"{text}\n")


class FaultyLink(VendorLink):
    def connect(self, listener):
        description = super().connect(listener)
        self._told_silent = False
        self._to, self._listener = listener, self
        return description

    def close(self):
        super().close()
        log("close")

    def configure(self, settings):
        if wrong("refuse settings"):
            raise TargetError("the target refuses PARAMETERS: it is beyond its limits")
        super().configure(settings)

    def levitate(self, seconds):
        log("levitate is asked for")
        while wrong("hold levitate"):
            time.sleep(0.01)
        super().levitate(seconds)
        log("levitate")

    def land(self, seconds):
        if wrong("refuse landing"):
            raise TargetError("no reply from the target to DELEVITATE")
        super().land(seconds)
        log(f"land {seconds:g}")

    def status(self):
        if wrong("silent"):
            raise TargetError("no reply from the target to HEARTBEAT")
        status = super().status()
        if not wrong("stand still"):
            self._shown_step = status.step
        return replace(status, step=self._shown_step)

    def _step(self):
        if wrong("switch off"):
            self._switch_off(TargetState.OFF)
        return super()._step()

    # -- as listener of itself

    def on_samples(self, block):
        if not wrong("no samples"):
            self._to.on_samples(block)

    def on_status(self, status):
        if not wrong("silent"):
            self._to.on_status(status)
