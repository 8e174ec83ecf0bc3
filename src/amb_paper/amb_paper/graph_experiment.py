"""Experiments on the paper's bearing that run through the ROS graph, and give the samples of the loop without ROS.

The bag of an experiment is kept, together with a note of the version of the code and the checksums of its files. It is
used again as long as these are the same and its samples are those of the loop without ROS, bit for bit.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import shutil
from dataclasses import dataclass
from pathlib import Path

from amb_bringup.client import amb_client, connection
from amb_bringup.demos.demo_run import controller_of, plant_of
from amb_bringup.graph import launch_file, launcher, own_graph
from amb_bringup.graph.launcher import own_domain
from amb_bringup.graph.packages import NODE_PACKAGES, share_folder
from amb_core.excitation import Excitation, ExcitationSignal, generate
from amb_core.ground.errors import BagError
from amb_core.ground.tasks.provenance import code_version
from amb_core.loop.control import ControllerParameters
from amb_core.loop.records import LoopRecord
from amb_core.plant.simulation import simulate_first_bearing
from amb_core.recording import Recording
from amb_paper.study import Claim, StudyError

SETTLING = 2_000  # steps; the rotor falls to its sag and comes to rest
_MODULES = (amb_client, connection, launch_file, launcher, own_graph)


@dataclass(frozen=True)
class LoopRun:
    """A run of the loop: its samples, and whether it ended because the rotor delevitated."""

    record: LoopRecord
    delevitated: bool

    @property
    def excited(self) -> LoopRecord:
        """The samples from the start of the excitation onwards."""
        return self.record.window(SETTLING, self.record.steps - SETTLING)


@dataclass(frozen=True)
class GraphExperiment:
    """An excitation of the bearing of config/paper.yaml, after it has come to rest.

    Attributes
    ----------
    name : str
        Name of its bag.
    excitation : Excitation
        Signal on the reference.
    """

    name: str
    excitation: Excitation

    @property
    def controller(self) -> ControllerParameters:
        """Parameters of the controller."""
        return controller_of(_parameter_file())

    @property
    def signal(self) -> ExcitationSignal:
        """Samples of the excitation."""
        return generate(self.excitation, self.controller.sample_rate)

    def without_ros(self) -> LoopRun:
        """The experiment without ROS."""
        plant = plant_of(_parameter_file())
        signal = self.signal
        record = simulate_first_bearing(plant, self.controller, SETTLING + signal.steps, signal.samples, SETTLING)
        return LoopRun(record, plant.delevitated)

    def through_ros(self, folder: Path, expected: LoopRun) -> LoopRun:
        """The experiment through the graph, from the bag in a folder of bags, which is recorded if necessary.

        Parameters
        ----------
        folder : Path
            Made if it does not exist.
        expected : LoopRun
            The experiment without ROS; a bag that differs from it is recorded again, once.

        Raises
        ------
        AmbError
            If the graph fails, or its bag cannot be read or written.
        """
        if self.is_kept(folder):
            try:
                kept = _read(folder / self.name)
            except BagError:
                kept = None
            if kept is not None and kept.record.identical_to(expected.record):
                return kept
        self._record(folder, expected.record.steps)
        return _read(folder / self.name)

    def is_kept(self, folder: Path) -> bool:
        """Whether the folder has an undamaged bag that was recorded with this version of the code."""
        try:
            note = json.loads(self._note(folder).read_text())
            return bool(note == {"version": self._version(), "files": _checksums(folder / self.name)})
        except (OSError, ValueError):
            return False

    def keep(self, folder: Path) -> None:
        """Note that the bag in the folder belongs to this version of the code; StudyError if that fails."""
        try:
            note = {"version": self._version(), "files": _checksums(folder / self.name)}
            self._note(folder).write_text(json.dumps(note, indent=1) + "\n")
        except OSError as problem:
            raise StudyError(f"{self._note(folder)}: cannot be written: {problem.strerror}") from None

    def _record(self, folder: Path, steps: int) -> None:
        bag, domain = folder / self.name, own_domain()
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._note(folder).unlink(missing_ok=True)
            if bag.exists():
                shutil.rmtree(bag)
        except OSError as problem:
            raise StudyError(f"bag {bag}: cannot be written: {problem.strerror}") from None
        arguments = {"params": str(_parameter_file())}
        with own_graph.own_graph("bearing", arguments, domain) as (graph, amb):
            amb.start_recording(str(bag.absolute()))
            run = amb.reset()
            amb.start_excitation(self.excitation.kind, first_step=SETTLING, **self.excitation.model_dump())
            amb.run(SETTLING + self.signal.steps)
            amb.stop_recording(run, steps)
            graph.check()
        self.keep(folder)

    def _note(self, folder: Path) -> Path:
        return folder / f"{self.name}.json"

    def _version(self) -> str:
        """Checksum of everything that determines the content of the bag."""
        described = json.dumps([self.name, SETTLING, self.excitation.kind, self.excitation.model_dump()])
        digest = hashlib.sha256((code_version() + described).encode())
        files = [_parameter_file(), launcher.launch_file("bearing"), Path(__file__)]
        files += [Path(inspect.getfile(module)) for module in _MODULES]
        for package in NODE_PACKAGES:
            files += sorted(Path(inspect.getfile(package)).parent.rglob("*.py"))
        for file in files:
            digest.update(file.read_bytes())
        return digest.hexdigest()


def equality_claim(name: str, figure: str, without: LoopRun, through: LoopRun) -> Claim:
    """Our own statement that the graph does not change the samples."""
    mine, theirs = without.record, through.record
    equal = theirs.identical_to(mine) and without.delevitated == through.delevitated
    finding = f"through ROS: {theirs.steps:,} samples equal bit for bit"
    if not equal:
        finding = f"{theirs.steps:,} samples through ROS and {mine.steps:,} without differ"
    return Claim(
        id=f"{name}-through-ros",
        paper_figure=figure,
        statement="Our statement, not the paper's: through the ROS graph, with nodes as processes connected by DDS, "
        "the experiment gives the samples of the loop without ROS.",
        finding=finding,
        verdict="agrees" if equal else "does not agree",
        reason="" if equal else "Lock-step is broken; the figures show the run without ROS.",
    )


def _read(bag: Path) -> LoopRun:
    recording = Recording.read(bag)
    if recording.truncated:
        raise BagError(f"bag {bag}: {recording.truncated}")
    return LoopRun(recording.telemetry(), recording.delevitation() is not None)


def _checksums(bag: Path) -> dict[str, str]:
    """Checksums of the files of a bag, by name; OSError if one cannot be read."""
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(bag.iterdir())}


def _parameter_file() -> Path:
    return share_folder("amb_bringup") / "config" / "paper.yaml"
