"""From what a user names to a certificate: the one path of command, service and `--again`.

First what is fast: model and controller are loaded and put together, so that what does not fit is refused at once.
Then the hashes, then the recordings, then the numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

from amb_core.data.analysis import RecordedLoop, read
from amb_core.data.analysis.recorded_sweeps import with_dwells
from amb_core.data.controller_choice import named_controller
from amb_core.data.experiments import DataDescription
from amb_core.data.tables import ENDINGS
from amb_core.ground.errors import IdentificationError
from amb_core.ground.files.regular_files import is_folder
from amb_core.ground.progress import Progress, unseen
from amb_core.linear.model import StateSpaceModel
from amb_core.loop.known_controller import KnownController
from amb_core.recording import Recording
from amb_core.robustness import (
    Certificate,
    RobustnessSettings,
    certify_from_data,
    sha256_of,
    sha256_of_controller,
    sha256_of_data,
    sha256_of_model,
)
from amb_core.robustness.from_data import require_fitting
from amb_core.robustness.trace import CertificateHeader, DataTrace, Trace, controller_values

ROLES = ("bag", "validation bag", "sweep bag")

Reader = Callable[[Path, DataDescription], RecordedLoop]


@dataclass(frozen=True)
class Request:
    """What is to be certified, by paths and names.

    Attributes
    ----------
    model : str
        File of the model; empty for one that is given otherwise.
    controller : str
        Name of the controller to certify, as for `named_controller`, or of a node; empty for that of the experiment.
    bag, validation_bag, sweep_bag : str
        What the model was identified from, what it is validated on, a swept sine; empty for none.
    description : str
        Description of data files of others.
    experiment_controller : str
        Controller of the experiments, as for `named_controller`; empty for the recorded one.
    settings : RobustnessSettings
        What is assumed and demanded.
    header : CertificateHeader
        Machine and signature.
    """

    model: str = ""
    controller: str = ""
    bag: str = ""
    validation_bag: str = ""
    sweep_bag: str = ""
    description: str = ""
    experiment_controller: str = ""
    settings: RobustnessSettings = field(default_factory=RobustnessSettings)
    header: CertificateHeader = field(default_factory=CertificateHeader)

    @property
    def named(self) -> dict[str, str]:
        """Paths and names, files as absolute paths."""
        names = ("model", "controller", "bag", "validation_bag", "sweep_bag", "description", "experiment_controller")
        values = {name: getattr(self, name) for name in names}
        return {name: str(Path(value).absolute()) if _is_file(value) else value for name, value in values.items()}


@dataclass(frozen=True, eq=False)
class InMemory:
    """What is given otherwise than by a file; empty where the request names one.

    Attributes
    ----------
    model : StateSpaceModel or None
        The model.
    law : KnownController or None
        The controller to certify, where its name is that of a node.
    experiment_law : KnownController or None
        The controller of the experiments, likewise.
    used, judged : RecordedLoop or None
        What the model was identified from, and what it is validated on.
    """

    model: StateSpaceModel | None = None
    law: KnownController | None = None
    experiment_law: KnownController | None = None
    used: RecordedLoop | None = None
    judged: RecordedLoop | None = None


def certify_request(
    request: Request,
    given: InMemory | None = None,
    reader: Reader = read,
    progress: Progress = unseen,
) -> Certificate:
    """The certificate of a request.

    Parameters
    ----------
    request : Request
        What is to be certified.
    given : InMemory, optional
        What is in no file.
    reader : callable, optional
        How a file is read with a description; a command shows what it understood.
    progress : callable, optional
        Called at each stage, see `amb_core.ground.progress.Progress`.

    Raises
    ------
    AmbError
        If something does not exist, cannot be read or does not fit together.
    """
    given = given or InMemory()
    model = given.model or StateSpaceModel.load(request.model)
    law = _named(request, model) if given.law is None else given.law.at_rate(1.0 / model.sample_time)
    stable = law is None or require_fitting(model, law, request.settings).stable
    inputs = _hashes(request, given, model)
    loops, traces = _recordings(request, given, inputs, reader) if stable else ({}, {})
    if law is None:
        law = _of_experiment(loops)
    name = request.named["controller"]
    inputs[f"controller {Path(name).name or 'of the experiment'}"] = sha256_of_controller(law)
    used, judged, swept = (loops.get(role) for role in ROLES)
    certificate = certify_from_data(
        model,
        law,
        used,
        judged,
        settings=request.settings,
        inputs=inputs,
        swept=swept,
        progress=lambda stage: progress(stage, 0, None),
    )
    trace = Trace(
        request.header,
        request.named,
        {"name": name, **controller_values(law)},
        {"order": model.order, "method": model.method, "source": model.source, "sha256": sha256_of_model(model)},
        traces,
    )
    return replace(certificate, trace=trace)


def require_request(request: Request) -> None:
    """Refuse at once what does not fit together or is not there, without reading data; AmbError if so."""
    model = StateSpaceModel.load(request.model)
    law = _named(request, model)
    if law is not None:
        require_fitting(model, law, request.settings)
    for name in ("bag", "validation_bag", "sweep_bag"):
        path = getattr(request, name)
        if path and not _is_file(path):
            raise IdentificationError(f"{name} {path}: there is no such file or folder")


def _named(request: Request, model: StateSpaceModel) -> KnownController | None:
    if not request.controller:
        return None
    return named_controller(request.controller, sample_rate=1.0 / model.sample_time)


def _of_experiment(loops: dict[str, RecordedLoop]) -> KnownController:
    for role in ("validation bag", "bag"):
        loop = loops.get(role)
        if loop is not None and loop.controller is not None:
            return loop.controller
    raise IdentificationError("the controller of the experiment is not known; name one in `controller`")


def _hashes(request: Request, given: InMemory, model: StateSpaceModel) -> dict[str, str]:
    """SHA-256 of everything that is read, by role and name."""
    inputs: dict[str, str] = {}
    if given.model is not None:
        inputs["model identified by the node"] = sha256_of_model(model)
    for name in ("model", "bag", "validation_bag", "sweep_bag", "description", "controller", "experiment_controller"):
        path = getattr(request, name)
        if path and (_is_file(path) or name not in ("description", "controller", "experiment_controller")):
            role = name.replace("_", " ") + (" file" if name.endswith("controller") else "")
            inputs[f"{role} {Path(path).name}"] = sha256_of(path)
    for role, loop in (("data", given.used), ("validation data", given.judged)):
        if loop is not None:
            inputs[f"{role} {loop.data.experiments[0].source}"] = sha256_of_data(loop.data)
    return inputs


def _recordings(
    request: Request, given: InMemory, inputs: dict[str, str], reader: Reader
) -> tuple[dict[str, RecordedLoop], dict[str, DataTrace]]:
    """The recordings by role, and where they come from."""
    known = DataDescription.given(request.description) or DataDescription.of()
    if given.experiment_law is None:
        known = known.with_values(controller=request.experiment_controller)
    loops: dict[str, RecordedLoop] = {}
    traces: dict[str, DataTrace] = {}
    for role, held in zip(ROLES, (given.used, given.judged, None), strict=True):
        path = getattr(request, role.replace(" ", "_"))
        if path:
            loop = reader(Path(path), known)
            loops[role] = with_dwells(path, loop) if role == ROLES[2] else loop
            traces[role] = DataTrace.of(
                loops[role].data, Path(path).name, inputs[f"{role} {Path(path).name}"], *_origin(Path(path))
            )  # fmt: skip
        elif held is not None:
            loops[role] = held
            traces[role] = DataTrace.of(held.data, held.data.experiments[0].source)
    if given.experiment_law is not None:
        law = given.experiment_law
        loops = {role: replace(loop, controller=law.at_rate(loop.data.sample_rate)) for role, loop in loops.items()}
    return loops, traces


def _origin(path: Path) -> tuple[int, str]:
    """Time of the first message of a bag (ns since 1970) and the name of its machine; 0 and empty for other files."""
    if path.suffix.lower() in ENDINGS:
        return 0, ""
    recording = Recording.read(path)
    machine = recording.machine() if recording.runs else None
    return recording.start, "" if machine is None else machine.name


def _is_file(path: str) -> bool:
    try:
        return bool(path) and (Path(path).is_file() or is_folder(Path(path)))
    except (OSError, ValueError):  # too long, or a NUL
        return False
