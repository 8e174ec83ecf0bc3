"""The command line `amb`: combines the commands, and shows errors meant for the user in one line."""

from __future__ import annotations

import importlib
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from amb_bringup.examples import with_examples
from amb_bringup.exit_codes import INTERRUPTED
from amb_bringup.startup import leaving_at_once
from amb_core.ground.errors import AmbError, MissingExtraError
from amb_core.ground.plain_text import plain_text
from amb_core.ground.version import __version__
from amb_ros import network
from amb_ros.interruptions import ending_signals

PASSING_ON = {"allow_extra_args": True, "allow_interspersed_args": False}
COMMANDS = {
    "Start": {
        "demo": (
            "demo:demo",
            "Levitate the bearing over ROS 2 topics, shake it with square waves, record, identify, validate.",
        ),
        "status": (
            "status:status",
            "Show what is in a folder of work on a bearing, what is stale, and the command that comes next.",
        ),
        "new": ("new:new", "Write a parameter file of your own bearing, with PD gains that levitate it."),
        "up": ("graph:up", "Start all nodes and show their output, until Ctrl-C."),
        "view": (
            "view:view",
            "Show a running graph live in the browser: motion, spectrum, regions, trips and log, until Ctrl-C.",
        ),
    },
    "Experiment": {
        "experiment": (
            "experiment:experiment",
            "Levitate, excite, record, land and report: experiments from start to end.",
        ),
        "excitation": ("excitation:app", "Check or design an excitation on a region map."),
        "map": (
            "map:region_map",
            "Find where regions B, C and D begin, amplitude by amplitude, from simulated sweeps.",
        ),
        "regions": (
            "regions:regions",
            "Show where regions B, C and D begin in the telemetry of a bag, and draw the response in its regions.",
        ),
        "distortion": (
            "distortion:distortion",
            "Measure nonlinear distortion: how much of the rotor's motion no linear model can explain.",
        ),
    },
    "Identify": {
        "identify": (
            "identify:identify",
            "Identify the plant from the last experiment of each bag, and check the model in closed loop on the "
            "same data.",
        ),
        "validate": (
            "validate:validate",
            "Validate a model: closed loop, distortion, predictions, residuals and frequency response, on one page.",
        ),
        "compare": ("compare:compare", "Compare models on the same data, the best closed loop first."),
        "model": ("model:app", "Export models."),
    },
    "Robustness and gains": {
        "certify": (
            "certify:certify",
            "Certify the robustness of a model with a controller: one page with the verdict first, "
            "and certificate.json.",
        ),
        "tune": ("tune:app", "Suggest PD gains, or draw which are stable."),
    },
    "Rig": {
        "commission": (
            "commission:commission",
            "Commission a rig: check sensors, coils, link, levitation, polarity, resonance, plant and protection.",
        ),
        "rig": ("rig:app", "Work with a rig behind a real-time target, real or emulated."),
    },
    "Data and reports": {
        "bag": ("bag:app", "Inspect, play, recover and export bags."),
        "report": (
            "report:report",
            "Regions, distortion, motion, identified model, frequency response, validation and robustness of a run.",
        ),
    },
    "Plant and paper": {
        "plant": ("plant:app", "Describe or plot the plant of a parameter file."),
        "reproduce": (
            "amb_paper.reproduce:reproduce",
            "Reproduce every figure and claim of the paper on the simulator; finished studies are not run again.",
        ),
    },
    "Special purposes": {
        "run": (
            "graph:run",
            "Run one executable of a package, as `ros2 run` does; further arguments are passed on (--ros-args ...).",
        ),
        "foxglove": (
            "foxglove:foxglove",
            "Show a running graph live in Foxglove, every sample of it, until Ctrl-C; needs the extra foxglove.",
        ),
        "jitter": (
            "jitter:jitter",
            "Show how late the steps of paced nodes come, and how many deadlines they miss, from /diagnostics.",
        ),
        "campbell": (
            "campbell:campbell",
            "Identify models at several running speeds, and draw their modes over the computed Campbell diagram.",
        ),
        "subharmonics": (
            "subharmonics:subharmonics",
            "Add three tones to the reference and find their products in the steady state of the position.",
        ),
    },
}
"""By purpose: where each command is, as `module:function` or, for a group of commands, `module:app`; and its first line
of help. A module with a dot in its name is one of another package, which may be missing."""


@contextmanager
def _package_of(module: str, command: str | None) -> Iterator[None]:
    """Import a command; MissingExtraError if the package with its module is not there."""
    package = module.partition(".")[0]
    try:
        yield
    except ModuleNotFoundError as problem:
        if problem.name != package:
            raise
        raise MissingExtraError(
            f"'amb {command}' belongs to the package '{package}', which is not found; build it (make setup)"
        ) from None


class LateCommand(TyperCommand):
    """A command with a module that is imported only when it is called: a list of the commands needs none of them."""

    def __init__(self, name: str, place: str, help: str, purpose: str) -> None:
        super().__init__(name, help=help, rich_help_panel=purpose)
        self._place = place

    def load(self) -> Any:
        """The command itself."""
        module, name = self._place.split(":")
        full = module if "." in module else f"amb_bringup.commands.{module}"
        with leaving_at_once(), _package_of(full, self.name):
            command_or_group = getattr(importlib.import_module(full), name)
            from amb_bringup.commands.options import with_changes
            from amb_bringup.commands.overwrite import with_overwrite
        if isinstance(command_or_group, typer.Typer):
            for command in command_or_group.registered_commands:
                command.callback = with_overwrite(with_changes(command.callback)) if command.callback else None
            return with_examples(get_command(command_or_group), self.name or "")
        app = typer.Typer(add_completion=False)
        app.command(self.name, context_settings=PASSING_ON if self.name == "run" else None)(
            with_overwrite(with_changes(command_or_group))
        )
        return with_examples(get_command(app), self.name or "")

    def make_context(self, *arguments: Any, **options: Any) -> Any:
        """The context of the command itself, in which it runs."""
        return self.load().make_context(*arguments, **options)


class Commands(TyperGroup):
    """The commands. Each one ends on Ctrl-C with one line and the exit code that shells expect."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        for purpose, commands in COMMANDS.items():
            for name, (place, help) in commands.items():
                self.add_command(LateCommand(name, place, help, purpose))

    def invoke(self, ctx: Any) -> Any:  # typer has a copy of click's types of its own
        """Run the requested command."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            typer.echo("amb: interrupted", err=True)
            raise typer.Exit(INTERRUPTED) from None


app = typer.Typer(
    name="amb",
    cls=Commands,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"amb {__version__}")
        raise typer.Exit


@app.callback()
def amb(
    version: Annotated[
        bool, typer.Option("--version", help="Show the version and exit.", callback=_show_version, is_eager=True)
    ] = False,
) -> None:
    """Workbench for active magnetic bearings on ROS 2: levitate, excite, record, identify."""


def main() -> int:
    """Run `amb` with the arguments of the process; returns its exit code."""
    network.keep_to_this_host()
    for number in ending_signals():  # a command may have something to close, nodes to stop or a rotor to land
        signal.signal(number, signal.default_int_handler)
    try:
        app()
        return 0
    except AmbError as problem:
        print(f"amb: {plain_text(problem)}", file=sys.stderr)
        return 1
