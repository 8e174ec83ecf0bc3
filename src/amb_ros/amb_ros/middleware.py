"""What keeps nodes reachable: settings against lost answers of services.

A request may reach a service before discovery has matched the service with the client's reader for answers.
rmw_fastrtps then waits 100 ms for the match and drops the answer, with only a warning (ros2/rmw_fastrtps, issue 842). A
loaded machine takes longer. A lost announcement is repeated within about 1.5 s, so 3 s allow for two of them. Parameter
services and actions of a node wait equally long, since the middleware does the waiting. Middlewares other than
rmw_fastrtps ignore these settings. `network` says who can reach the nodes, `overflowed_wait` and `unnoticed_arrival`
which faults are corrected.
"""

from __future__ import annotations

import os
from pathlib import Path

from amb_ros import network, overflowed_wait, unnoticed_arrival

PROFILES = Path(__file__).with_name("fast_dds.xml")
LOCAL_PROFILES = Path(__file__).with_name("fast_dds_local.xml")
VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"


def configure() -> None:
    """Apply the settings to this process unless the user has set their own; call it before `rclpy.init`.

    Then correct the faults by which a process can hang when it ends, and by which an answer can stay unnoticed.
    """
    os.environ.setdefault(VARIABLE, str(LOCAL_PROFILES if network.is_local() else PROFILES))
    overflowed_wait.correct()
    unnoticed_arrival.correct()
