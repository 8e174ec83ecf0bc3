"""What a user gets who sources the workspace only, in the Python of the system."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[2]


def amb(*arguments: str) -> subprocess.CompletedProcess[str]:
    script = f"source {ROOT}/install/local_setup.bash && exec amb {' '.join(arguments)}"
    bare = {"HOME": os.environ["HOME"], "PATH": "/usr/local/bin:/usr/bin:/bin"}
    return subprocess.run(["bash", "-c", script], env=bare, capture_output=True, text=True)


def test_the_command_line_runs_in_the_python_that_built_the_workspace() -> None:
    shown = amb("--version")
    assert (shown.returncode, shown.stderr) == (0, "")
    assert shown.stdout.startswith("amb ")


def test_a_recorder_that_lacks_ros_names_what_to_source() -> None:
    refused = amb("run", "amb_ident_node", "recorder")
    assert refused.returncode == 1
    (line,) = refused.stderr.splitlines()
    assert "its package is not in AMENT_PREFIX_PATH; source ROS 2 before the workspace" in line
