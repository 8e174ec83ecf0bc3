"""Settings of the middleware, by which no answer of a service gets lost on a busy machine.

A request may reach a service before discovery has matched the service with the reader that the client has for answers.
rmw_fastrtps then waits 100 ms for it and drops the answer, with nothing but a warning (ros2/rmw_fastrtps, issue 842). A
loaded machine takes longer. An announcement that got lost is told again within some 1.5 s, so 3 s are room for two.
Parameter services and actions of a node wait as long: it is their middleware that does. Other middlewares than
rmw_fastrtps do not read these settings.
"""

from __future__ import annotations

import os
from pathlib import Path

PROFILES = Path(__file__).with_name("fast_dds.xml")
VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"


def configure() -> None:
    """Let this process use the settings, unless the user has some of their own; call it before `rclpy.init`."""
    os.environ.setdefault(VARIABLE, str(PROFILES))
