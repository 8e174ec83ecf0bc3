"""Ctrl-C: one line and exit code 130 from `amb`, silence and exit code 0 from a node, also while they import."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from amb_bringup.graph.packages import find_executable
from amb_ros.interruptions import SIGNALS

ROOT = Path(__file__).parents[2]
SETUPS = sorted([*ROOT.glob("amb_*/setup.py"), *ROOT.glob("src/*/setup.py")])
SLOW_MODULE = "import sys, time\nprint('importing', flush=True)\ntime.sleep(20)\n"


def python(code: str, path: Path, *arguments: str) -> subprocess.Popen[str]:
    environment = os.environ | {"PYTHONPATH": f"{path}:{os.environ.get('PYTHONPATH', '')}"}
    return subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment,
    )  # fmt: skip


def interrupted(process: subprocess.Popen[str], number: signal.Signals = signal.SIGINT) -> tuple[int, str, str]:
    """Exit code and the rest of both outputs of a process that is sent a signal as soon as it says something."""
    assert process.stdout is not None
    assert process.stdout.readline().strip() == "importing"
    process.send_signal(number)
    out, error = process.communicate(timeout=30.0)
    return process.returncode, out, error


@pytest.mark.parametrize("number", SIGNALS)
def test_a_node_that_is_interrupted_while_it_imports_ends_in_silence(tmp_path: Path, number: signal.Signals) -> None:
    (tmp_path / "slow_node.py").write_text(SLOW_MODULE)
    process = python("from amb_ros.startup import start; start('slow_node')", tmp_path)
    assert interrupted(process, number) == (0, "", "")


def test_amb_that_is_interrupted_while_it_imports_ends_with_one_line(tmp_path: Path) -> None:
    (tmp_path / "typer.py").write_text(SLOW_MODULE)
    process = python("import sys; from amb_bringup.command_line import main; sys.exit(main())", tmp_path)
    assert interrupted(process) == (130, "", "amb: interrupted\n")


@pytest.mark.parametrize("number", SIGNALS)
def test_a_command_that_is_interrupted_ends_with_one_line(tmp_path: Path, number: signal.Signals) -> None:
    code = (
        "import sys, time\n"
        "from amb_bringup import cli, command_line\n"
        "@cli.app.command()\n"
        "def wait():\n"
        "    print('importing', flush=True)\n"
        "    time.sleep(20)\n"
        "sys.exit(command_line.main())\n"
    )
    assert interrupted(python(code, tmp_path, "wait"), number) == (130, "", "amb: interrupted\n")


@pytest.mark.parametrize("setup", SETUPS, ids=lambda path: path.parent.name)
def test_every_executable_starts_in_a_module_that_imports_no_node(setup: Path) -> None:
    starts = re.findall(r'"(\w+)=([\w.]+):(\w+)"', setup.read_text())
    for name, module, function in starts:
        assert module in (f"{setup.parent.name}.executables", "amb_bringup.command_line"), name
        assert function in (name, "main")
    code = (
        f"import {', '.join({module for _, module, _ in starts} or {'sys'})}; import sys; print('numpy' in sys.modules)"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "False"


def processor_time(pid: int) -> float:
    """What a process has used so far (s)."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@pytest.mark.slow
@pytest.mark.parametrize("used", [0.2, 0.4, 0.7, 1.0, 1.4, 2.0, 3.0])
@pytest.mark.parametrize("executable", ["amb", "simulator"])
def test_no_traceback_whenever_ctrl_c_comes(executable: str, used: float, tmp_path: Path) -> None:
    """From where Python itself has started, by the time of the processor that was used (s), into the run.

    A simulator that has started and waits for a controller uses no more: it is interrupted then.
    """
    name = ("amb_bringup", "amb") if executable == "amb" else ("amb_sim_node", "simulator")
    command = [
        str(find_executable(*name)),
        *(["map", "--duration", "600", "--cache", "cache"] if executable == "amb" else []),  # for minutes
    ]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=tmp_path)
    last, since = 0.0, time.monotonic()
    while process.poll() is None and (now := processor_time(process.pid)) < used:
        if now > last + 0.1:  # more than the simulator's watch on its controller takes
            last, since = now, time.monotonic()
        elif now > 0.5 and time.monotonic() - since > 10.0:
            break
        time.sleep(0.001)
    process.send_signal(signal.SIGINT)
    said, _ = process.communicate(timeout=60.0)
    assert "Traceback" not in said
    assert process.returncode == (130 if executable == "amb" else 0)


def test_a_connection_that_is_interrupted_in_a_destructor_of_its_executor_closes_first(tmp_path: Path) -> None:
    code = (
        "import signal, sys\n"
        "from amb_bringup.client import AmbClient\n"
        "def interrupt(frame, event, _):\n"
        "    where = frame.f_code\n"
        "    if event == 'call' and where.co_name == '__exit__' and 'event_handler' in where.co_filename:\n"
        "        sys.setprofile(None)\n"
        "        print('destroying', flush=True)\n"
        "        signal.raise_signal(signal.SIGINT)\n"
        "client = AmbClient()\n"
        "client.spin_once()\n"
        "sys.setprofile(interrupt)\n"
        "try:\n"
        "    client.close()\n"
        "except KeyboardInterrupt:\n"
        "    print('interrupted', client.node.context.ok())\n"
    )
    process = python(code, tmp_path)
    out, error = process.communicate(timeout=120.0)
    assert (process.returncode, error) == (0, "")
    assert out.endswith("destroying\ninterrupted False\n"), out  # before it, Fast DDS may complain of what others left


def test_a_connection_that_nobody_closes_is_closed_before_the_interpreter_ends(tmp_path: Path) -> None:
    code = (
        "import atexit\n"
        "atexit.register(lambda: print('open:', client.node.context.ok()))\n"
        "from amb_bringup.client import AmbClient\n"
        "client = AmbClient()\n"
        "client.spin_once()\n"
    )
    out, error = python(code, tmp_path).communicate(timeout=120.0)
    assert error == ""
    assert out.endswith("open: False\n"), out
