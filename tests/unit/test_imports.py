"""What a process imports when it starts: a second of imports is a second of waiting, in every node of every graph."""

from __future__ import annotations

import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    ("module", "unwanted"),
    [
        ("amb_ident_node.recorder", ("scipy.signal", "numba")),
        ("amb_controller_node.excitation_generator", ("scipy.signal",)),
        ("amb_sim_node.hardware_bridge", ("amb_core.plant", "scipy.interpolate")),
        ("amb_bringup.cli", ("numpy", "rclpy")),
    ],
)
def test_a_process_starts_without_what_it_does_not_compute_with(module: str, unwanted: tuple[str, ...]) -> None:
    code = f"import {module}, sys; print([name for name in {unwanted!r} if name in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
