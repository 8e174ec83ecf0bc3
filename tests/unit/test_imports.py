"""What a process imports when it starts: a second of imports is a second of waiting, in every node of every graph."""

from __future__ import annotations

import subprocess
import sys

import pytest

from amb_bringup.cli import COMMANDS


@pytest.mark.parametrize(
    ("module", "unwanted"),
    [
        ("amb_ident_node.recorder", ("scipy.signal", "numba")),
        ("amb_controller_node.excitation_generator", ("scipy.signal",)),
        ("amb_sim_node.hardware_bridge", ("amb_core.plant", "scipy.interpolate")),
        ("amb_ident_node.identifier", ("scipy.signal", "scipy.stats")),
        ("amb_bringup.client", ("numba", "scipy", "amb_core.identification", "amb_core.regions")),
        ("amb_bringup.cli", ("numpy", "rclpy")),
    ],
)
def test_a_process_starts_without_what_it_does_not_compute_with(module: str, unwanted: tuple[str, ...]) -> None:
    code = f"import {module}, sys; print([name for name in {unwanted!r} if name in sys.modules])"
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert process.stdout.strip() == "[]"


LIGHT_HELP = (
    "bag",
    "bag info",
    "bag play",
    "bag export",
    "demo",
    "foxglove",
    "model export",
    "reproduce",
    "rig",
    "run",
)


@pytest.mark.parametrize("command", [*LIGHT_HELP, "up", "view"])
def test_help_imports_neither_nodes_nor_what_computes(command: str) -> None:
    code = (
        "import sys; from typer.testing import CliRunner; from amb_bringup.cli import app; "
        "assert CliRunner().invoke(app, [*sys.argv[1:], '-h']).exit_code == 0; "
        "print([name for name in ('rclpy', 'amb_msgs', 'numpy', 'scipy', 'numba', 'rosbags') if name in sys.modules]); "
        "print(len(sys.modules))"
    )
    process = subprocess.run([sys.executable, "-c", code, *command.split()], capture_output=True, text=True, check=True)
    heavy, count = process.stdout.splitlines()
    assert heavy == "[]"
    assert int(count) < 700  # 320 of them are those of Python, typer and rich


def test_help_of_no_command_imports_what_draws_or_what_joins_a_graph() -> None:
    groups = ["plant modes", "plant figures", "tune chart", "excitation design", "bag export"]
    every = [name for commands in COMMANDS.values() for name in commands] + groups
    code = (
        "import sys; from typer.testing import CliRunner; from amb_bringup.cli import app\n"
        "for command in sys.argv[1:]:\n"
        "    assert CliRunner().invoke(app, [*command.split(), '-h']).exit_code == 0, command\n"
        "    print(command, [name for name in ('rclpy', 'amb_msgs', 'matplotlib', 'plotly') if name in sys.modules])"
    )
    process = subprocess.run([sys.executable, "-c", code, *every], capture_output=True, text=True, check=True)
    assert process.stdout.splitlines() == [f"{command} []" for command in every]
