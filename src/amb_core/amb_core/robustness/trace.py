"""Where a certificate comes from: machine, data, controller, program and standards, so that it can be made again."""

from __future__ import annotations

import subprocess
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from amb_core.data.experiments import IdentificationData
from amb_core.ground.errors import RobustnessError
from amb_core.ground.parameters import Parameters, choice, validate
from amb_core.ground.tasks.provenance import code_version
from amb_core.ground.version import __version__
from amb_core.linear import Arrays
from amb_core.linear.model import StateSpaceModel
from amb_core.loop.known_controller import KnownController, LinearControl
from amb_core.loop.linear_parameters import LinearControllerParameters
from amb_core.loop.pd_parameters import ControllerParameters
from amb_core.robustness.hashes import sha256_of_controller, sha256_of_data

BAND = 0.999  # share of the power of the references within their band
STANDARDS = (
    ("ISO 14839-1", "2018", "terms", "vocabulary"),
    ("ISO 14839-2", "2004", "zones of displacement over clearance", "evaluation criteria: zone limits of displacement"),
    (
        "ISO 14839-3",
        "2006",
        "sensitivity, its measurement, its zones",
        "measurement and zone limits of the sensitivity",
    ),
)
"""Standard, edition, what is taken from it, and the subject of the clauses, whose numbers are to be checked there."""


class CertificateHeader(Parameters):
    """What a certificate states of the machine and its signature, and cannot find in the data."""

    machine: str = choice("", "machine that is certified; by default the name in the bag")
    serial_number: str = choice("", "its serial number")
    speed: str = choice("", "running speed at which the data were taken, such as 12000 rpm")
    load: str = choice("", "load at which the data were taken")
    author: str = choice("", "who signs")
    validity: str = choice("", "how long, and until which change, the certificate is valid")


@dataclass(frozen=True)
class DataTrace:
    """A recording that a certificate rests on.

    Attributes
    ----------
    name : str
        File, or where the data come from.
    sha256 : str
        Of the file; empty for data that are in none.
    sha256_of_samples : str
        Of the samples that were used.
    recorded : str
        Time of the first message (ISO 8601, UTC); empty if it is not known.
    machine : str
        Name of the machine in the bag.
    samples : int
        Number of samples.
    sample_rate : float
        Sample rate (Hz).
    amplitude, current, reference : mapping
        Largest deviation from the mean: of positions (m) and references (m) by axis, and of currents (A).
    excited_band : tuple of float
        Frequencies (Hz) between which the references have 99.9 % of their power; empty without references.
    """

    name: str
    sha256: str
    sha256_of_samples: str
    recorded: str
    machine: str
    samples: int
    sample_rate: float
    amplitude: Mapping[str, float]
    current: Mapping[str, float]
    reference: Mapping[str, float]
    excited_band: tuple[float, ...]

    @classmethod
    def of(cls, data: IdentificationData, name: str, sha256: str = "", start: int = 0, machine: str = "") -> DataTrace:
        """Of data; `start` in ns since 1970, 0 if it is not known."""

        def largest(names: tuple[str, ...], signals: list[Arrays]) -> dict[str, float]:
            size = np.max([np.abs(one - one.mean(axis=0)).max(axis=0) for one in signals], axis=0) if signals else []
            return {one: float(value) for one, value in zip(names, size, strict=False)}

        references = [item.reference for item in data.experiments if item.reference is not None]
        outputs = tuple(data.output_names)
        return cls(
            name,
            sha256,
            sha256_of_data(data),
            datetime.fromtimestamp(start * 1e-9, UTC).isoformat(timespec="seconds") if start else "",
            machine,
            data.samples,
            data.sample_rate,
            largest(outputs, [item.outputs for item in data.experiments]),
            largest(tuple(data.input_names), [item.inputs for item in data.experiments]),
            largest(outputs, references),
            _band(references, data.sample_time),
        )


@dataclass(frozen=True)
class Trace:
    """Where a certificate comes from.

    Attributes
    ----------
    header : CertificateHeader
        Machine and signature.
    request : mapping
        What was asked for: paths and names, empty where there is none.
    controller : mapping
        The controller to certify with all its gains.
    model : mapping
        Order, method and hash of the model.
    data : mapping
        By role: bag, validation bag, sweep bag.
    made : mapping
        Date, version, commit and checksum of the code.
    """

    header: CertificateHeader
    request: Mapping[str, str]
    controller: Mapping[str, Any]
    model: Mapping[str, Any]
    data: Mapping[str, DataTrace]
    made: Mapping[str, str] = field(default_factory=lambda: made_now())

    def values(self) -> dict[str, Any]:
        """As plain values for certificate.json."""
        return {
            "made": dict(self.made),
            "header": self.header.model_dump() | {"machine": self.machine},
            "standards": [
                {"standard": name, "edition": edition, "used_for": use, "clauses": clauses}
                for name, edition, use, clauses in STANDARDS
            ],
            "request": dict(self.request),
            "controller": dict(self.controller),
            "model": dict(self.model),
            "data": {role: asdict(one) for role, one in self.data.items()},
        }

    @property
    def machine(self) -> str:
        """Name of the machine: the given one, or that of a bag."""
        return self.header.machine or next((one.machine for one in self.data.values() if one.machine), "")


def made_now() -> dict[str, str]:
    """Date, version of the workbench, commit of its checkout (empty outside one), and checksum of the library."""
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "version": __version__,
        "commit": _commit(),
        "code": code_version(),
    }


def controller_values(controller: KnownController) -> dict[str, Any]:
    """A controller with all its gains and its hash; `controller_from` makes it again without loss."""
    by_name: dict[str, Any] = {"sha256": sha256_of_controller(controller)}
    if isinstance(controller, LinearControl):
        return by_name | {
            "kind": "linear",
            "model": controller.model.to_json(),
            "parameters": controller.parameters.model_dump(mode="json"),
        }
    return by_name | {"kind": "pd", "parameters": controller.model_dump(mode="json")}


def controller_from(values: Mapping[str, Any]) -> KnownController:
    """The controller of `controller_values`.

    Raises
    ------
    AmbError
        If the values are none, or are not those of their hash.
    """
    try:
        if values["kind"] == "linear":
            law = StateSpaceModel.from_json(values["model"])
            controller: KnownController = LinearControl(law, validate(LinearControllerParameters, values["parameters"]))
        else:
            controller = validate(ControllerParameters, values["parameters"])
        expected = values["sha256"]
    except (KeyError, TypeError) as problem:
        raise RobustnessError(f"controller of the certificate: {problem} is missing or wrong") from None
    if sha256_of_controller(controller) != expected:
        raise RobustnessError("controller of the certificate: its gains are not those of its SHA-256")
    return controller


def _band(references: list[Arrays], sample_time: float) -> tuple[float, ...]:
    powers, frequencies = [], []
    for reference in references:
        lines = np.fft.rfft(reference - reference.mean(axis=0), axis=0)
        powers.append(np.sum(np.abs(lines) ** 2, axis=1) / len(reference))
        frequencies.append(np.fft.rfftfreq(len(reference), sample_time))
    if not powers or not sum(power.sum() for power in powers) > 0.0:
        return ()
    power, frequency = np.concatenate(powers), np.concatenate(frequencies)
    order = np.argsort(frequency, kind="stable")
    share = np.cumsum(power[order]) / power.sum()
    ends = np.searchsorted(share, [0.5 * (1.0 - BAND), 0.5 * (1.0 + BAND)])
    return tuple(float(frequency[order][min(end, len(order) - 1)]) for end in ends)


def _commit() -> str:
    """Commit of the checkout in which this file lies, with + if files differ from it; empty if there is none."""
    file = Path(__file__)

    def git(*words: str) -> str:
        run = subprocess.run(["git", *words], cwd=file.parent, capture_output=True, text=True, timeout=10, check=True)
        return run.stdout.strip()

    try:
        git("ls-files", "--error-unmatch", file.name)  # else the checkout is that of something else
        return git("rev-parse", "HEAD") + ("+" if git("status", "--porcelain", "--untracked-files=no", "..") else "")
    except (OSError, subprocess.SubprocessError):
        return ""
