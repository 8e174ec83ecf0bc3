"""A certificate computed again from its certificate.json, its bags and its model: the same numbers, or what differs."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from amb_core.ground.errors import RobustnessError
from amb_core.ground.files.file_errors import reading
from amb_core.ground.files.regular_files import MIB, read_text
from amb_core.ground.parameters import validate
from amb_core.ground.progress import Progress, unseen
from amb_core.report.pages.certification import InMemory, Request, certify_request
from amb_core.robustness import Certificate, RobustnessSettings, certificate_values
from amb_core.robustness.trace import CertificateHeader, controller_from

LARGEST = 64 * MIB
CLOSE = 1e-6  # relative, of two numbers that are taken as the same
NEGLIGIBLE = 1e-9  # numbers below, such as the distance of a replayed pole from its place, are those of rounding
_NOT_COMPARED = ("made", "header", "request", "inputs", "data", "standards", "verdict", "warnings", "finding")
_FILES = ("model", "bag", "validation_bag", "sweep_bag", "description", "experiment_controller")


@dataclass(frozen=True, eq=False)
class Again:
    """What came out.

    Attributes
    ----------
    certificate : Certificate
        The new one.
    differences : tuple of str
        Files, numbers and verdicts that are not the same, one each.
    remarks : tuple of str
        What is not the same and changed no number: version, or the place of a file.
    compared : int
        Number of compared values.
    """

    certificate: Certificate
    differences: tuple[str, ...]
    remarks: tuple[str, ...]
    compared: int


def certify_again(path: str | Path, files: Mapping[str, str] | None = None, progress: Progress = unseen) -> Again:
    """Compute a certificate again.

    Parameters
    ----------
    path : path
        certificate.json.
    files : mapping, optional
        Paths of model, bag, validation_bag, sweep_bag and description that have moved, or were in no file.
    progress : callable, optional
        Called with the name of each stage.

    Raises
    ------
    AmbError
        If it is no certificate that can be computed again, or a file is missing.
    """
    old = _loaded(Path(path))
    given = {name: place for name, place in (files or {}).items() if place}
    request = _request(old, Path(path), given)
    new = certify_request(request, InMemory(law=controller_from(old["controller"])), progress=progress)
    values = json.loads(json.dumps(certificate_values(new)))
    differences = list(_changed_inputs(old, values))
    before, after = dict(_leaves(old)), dict(_leaves(values))
    for name in dict.fromkeys([*before, *after]):
        one, other = before.get(name, "nothing"), after.get(name, "nothing")
        if not _same(one, other):
            differences.append(f"{name}: {_shown(one)} before, {_shown(other)} now")
    return Again(new, tuple(differences), tuple(_remarks(old, values)), len(before))


def _loaded(path: Path) -> dict[str, Any]:
    with reading("certificate", path):
        content = json.loads(read_text(path, LARGEST))
    needed = ("request", "settings", "controller", "header", "made", "inputs", "model", "data")
    lacking = [name for name in needed if not isinstance(content, dict) or not isinstance(content.get(name), dict)]
    if lacking:
        raise RobustnessError(
            f"certificate {path}: has no {', '.join(lacking)}; one of an earlier version cannot be computed again"
        )
    return dict(content)


def _request(old: Mapping[str, Any], path: Path, given: Mapping[str, str]) -> Request:
    """The request of a certificate, with files where they are now: as given, as before, or beside the certificate."""
    known = {item.name for item in fields(Request)}
    named = {name: str(value) for name, value in old["request"].items() if name in known}
    needed = {"model", *(role.replace(" ", "_") for role in old["data"])}
    for name in _FILES:
        before = named.get(name, "")
        if name in given:
            named[name] = given[name]
        elif Path(before).is_absolute() and not Path(before).exists():
            beside = path.parent / Path(before).name
            if not beside.exists():
                raise RobustnessError(f"{name} {before}: there is no such file or folder; give it as it is now")
            named[name] = str(beside)
        elif not before and name in needed:
            raise RobustnessError(
                f"certificate {path}: its {name} was in no file; give one with the same content, if there is one"
            )
    return replace(
        Request(),
        **named,
        settings=validate(RobustnessSettings, old["settings"]),
        header=validate(CertificateHeader, old["header"]),
    )


def _changed_inputs(old: Mapping[str, Any], new: Mapping[str, Any]) -> Iterator[str]:
    """Files and samples that are not those of the certificate, by hash."""
    if old["model"].get("sha256") != new["model"]["sha256"]:
        yield f"model: its matrices have the SHA-256 {new['model']['sha256']}, before {old['model'].get('sha256')}"
    for role in sorted({*old["data"], *new["data"]}):
        before, now = (values["data"].get(role, {}) for values in (old, new))
        for what, key in (("file", "sha256"), ("samples", "sha256_of_samples")):
            if before.get(key) and before.get(key) != now.get(key):
                yield f"{role} {before.get('name')}: the SHA-256 of the {what} is {now.get(key)}, before {before[key]}"
    texts = ("description", "controller file", "experiment controller file")
    files = [name for name in old["inputs"] if name.startswith(texts)]
    for name in files:
        now = new["inputs"].get(name, {}).get("sha256")  # the gains of one that is gone are in the certificate
        if now is not None and now != old["inputs"][name].get("sha256"):
            yield f"{name}: SHA-256 {now}, before {old['inputs'][name].get('sha256')}"


def _remarks(old: Mapping[str, Any], new: Mapping[str, Any]) -> Iterator[str]:
    for key in ("version", "commit", "code"):
        before, now = old["made"].get(key), new["made"][key]
        if before != now:
            yield f"{key} of the workbench: {now or 'not known'}, before {before or 'not known'}"


def _leaves(values: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Every compared value of a certificate by its path."""
    if isinstance(values, dict):
        pairs: Any = values.items()
    elif isinstance(values, list):
        pairs = enumerate(values)
    else:
        yield name, values
        return
    for key, item in pairs:
        if key not in _NOT_COMPARED:
            yield from _leaves(item, f"{name}.{key}" if name else str(key))


def _same(one: Any, other: Any) -> bool:
    numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in (one, other))
    if not numbers:
        return type(one) is type(other) and one == other
    return math.isclose(one, other, rel_tol=CLOSE, abs_tol=NEGLIGIBLE)


def _shown(value: Any) -> str:
    return f"{value:.9g}" if isinstance(value, float) else str(value)
