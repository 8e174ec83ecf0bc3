"""Which items of a project are stale: by the parameters that maps and bags record, and by SHA-256 of what was read."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from amb_core.ground.errors import AmbError, ProjectError
from amb_core.ground.files.parameter_files import ParameterFile
from amb_core.ground.files.regular_files import read_text
from amb_core.ground.given_values import path_of
from amb_core.ground.parameters import Parameters, load_parameters
from amb_core.ground.results import Result
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.recording import Recording
from amb_core.report.project.items import Item, State, find_items
from amb_core.report.project.next_step import NextStep, next_step
from amb_core.robustness.hashes import sha256_of

_NODES: dict[str, type[Parameters]] = {"simulator": PlantParameters, "pd_controller": ControllerParameters}
_NAMED = 3  # differing parameters that a reason names


@dataclass(frozen=True, repr=False)
class ProjectStatus(Result):
    """What is in a project's folder.

    Attributes
    ----------
    items : tuple of Item
        By kind, in the order of the work.
    step : NextStep
        The command that comes next.
    """

    items: tuple[Item, ...]
    step: NextStep

    @property
    def summary(self) -> str:
        """One line of text."""
        stale = sum(item.state is State.STALE for item in self.items)
        return f"{len(self.items)} items, {stale} stale; next: {self.step.command or self.step.reason}"

    @property
    def rows(self) -> list[tuple[str, str]]:
        """The items with their states."""
        return [
            (f"{item.kind} {item.path}", f"{item.state}{': ' * bool(item.reason)}{item.reason}") for item in self.items
        ]

    def as_dict(self) -> dict[str, Any]:
        """All as plain values for strict JSON.

        Returns
        -------
        dict
            `items`, each with kind, path, state and reason, and `next` with command and reason.
        """
        return {
            "items": [
                {"kind": item.kind, "path": str(item.path), "state": item.state, "reason": item.reason}
                for item in self.items
            ],
            "next": {"command": self.step.command, "reason": self.step.reason},
        }


def status_of(folder: str | Path) -> ProjectStatus:
    """What is in a folder, what is stale, and what comes next.

    A map or experiment is stale if a parameter that the bearing's file states has another value there; parameters that
    only the result has, as by --set, are named. Everything else is stale if what it was made from is stale or has
    another SHA-256 now.

    Parameters
    ----------
    folder : str or Path
        Folder with the bearing's file; results are found in it and in its folders.

    Returns
    -------
    ProjectStatus
        What was found, each with its state, and the next step.

    Raises
    ------
    ProjectError
        If it is not a folder that can be read.
    """
    place = path_of("folder", folder, ProjectError)
    judge = _Judge(place)
    items = tuple(judge.judged(item) for item in find_items(place))
    return ProjectStatus(items, next_step(items))


class _Judge:
    """Judges the items of a folder in the order of the work, each by those before it."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._bearings: list[dict[str, dict[str, Any]]] = []  # of each file: by node, all parameters
        self._stated: set[str] = set()
        self._known: dict[str, Item] = {}  # by name of the file or bag
        self._hashes: dict[Path, str] = {}
        self._inputs: dict[Path, tuple[str, ...]] = {}  # of each model

    def judged(self, item: Item) -> Item:
        """The item with its state."""
        try:
            state, reason = getattr(self, f"_{item.kind}")(item)
        except AmbError as problem:
            state, reason = State.UNKNOWN, str(problem)
        judged = replace(item, state=state, reason=reason, inputs=self._inputs.get(item.path, ()))
        self._known[str(item.path)] = judged
        return judged

    def _bearing(self, item: Item) -> tuple[State, str]:
        file = ParameterFile(self._folder / item.path)
        for node in _NODES:
            self._stated |= {f"{node}.{name}" for name in file.values(node)}
        self._bearings.append(
            {
                node: load_parameters(model, self._folder / item.path, node, part=True).model_dump()
                for node, model in _NODES.items()
            }
        )
        return State.CURRENT, ""

    def _map(self, item: Item) -> tuple[State, str]:
        made = item.content["provenance"]
        return self._of_bearing({"simulator": made.get("plant"), "pd_controller": made.get("controller")})

    def _design(self, item: Item) -> tuple[State, str]:
        return self._of_inputs(item.content.get("inputs"))

    def _experiment(self, item: Item) -> tuple[State, str]:
        recording = Recording.read(self._folder / item.path)
        plant, controller = recording.plant_parameters(), recording.controller_parameters()
        if plant is None:
            return State.CURRENT, "of a rig, or of another program: no plant is recorded"
        return self._of_bearing(
            {
                "simulator": plant.model_dump(),
                "pd_controller": None if controller is None else controller.model_dump(),
            }
        )

    def _model(self, item: Item) -> tuple[State, str]:
        try:
            summary = json.loads(read_text((self._folder / item.path).with_name("summary.json")))
        except (OSError, ValueError):
            return State.UNKNOWN, "no summary.json beside it records its inputs"
        inputs = summary.get("inputs")
        self._inputs[item.path] = tuple(inputs or ())
        return self._of_inputs(inputs)

    def _certificate(self, item: Item) -> tuple[State, str]:
        """By its inputs, which are named by role, without folder."""
        named = {}
        request, inputs = item.content.get("request"), item.content["inputs"]
        for field, path in request.items() if isinstance(request, dict) and isinstance(inputs, dict) else ():
            role = field.replace("_", " ") + " file" * field.endswith("controller")
            recorded = inputs.get(f"{role} {Path(path).name}") if path and isinstance(path, str) else None
            if isinstance(recorded, dict) and isinstance(recorded.get("sha256"), str):
                named[self._place(path, item, recorded["sha256"])] = recorded["sha256"]
        state, reason = self._of_inputs(named)
        verdict = str(item.content.get("statement", "not certified"))
        return state, f"{verdict}{'; ' * bool(reason)}{reason}"

    def _place(self, path: str, item: Item, digest: str) -> str:
        """Where an input of an item is in the folder; its name if it is nowhere. Nothing outside is read."""
        name, folder, whole = Path(path).name, self._folder.resolve(), Path(path).resolve()
        inside = [str(whole.relative_to(folder))] if whole.is_relative_to(folder) else []
        files = [place for place in (*inside, str(item.path.parent / name), name) if (folder / place).is_file()]
        places = [*(known for known in self._known if Path(known).name == name), *files]
        same = (place for place in places if self._hash(place) == digest)
        return next(same, places[0] if places else name)

    def _of_bearing(self, made: Mapping[str, Any]) -> tuple[State, str]:
        """By parameters, of the bearing that they suit best."""
        if not self._bearings:
            return State.UNKNOWN, "there is no parameter file of its bearing"
        differing = min((self._differences(made, bearing) for bearing in self._bearings), key=len)
        stated = [text for name, text in differing.items() if name in self._stated]
        shown = ", ".join([*(stated or differing.values())][:_NAMED])
        more = len(stated or differing) - _NAMED
        shown += f" and {more} more" if more > 0 else ""
        if stated:
            return State.STALE, f"made with {shown}"
        return State.CURRENT, f"with {shown}" if shown else ""

    @staticmethod
    def _differences(made: Mapping[str, Any], bearing: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
        """Parameters that were other ones, by name, with both values as text."""
        differences = {}
        for node, values in made.items():
            was, now = _flat(node, values or {}), _flat(node, bearing[node])
            for name in was.keys() & now.keys():
                if was[name] != now[name]:
                    differences[name] = f"{name.partition('.')[2]} = {was[name]} (now {now[name]})"
        return dict(sorted(differences.items()))

    def _of_inputs(self, inputs: Mapping[str, str] | None) -> tuple[State, str]:
        if not inputs:
            return State.UNKNOWN, "it does not record its inputs; older versions did not"
        for name, digest in inputs.items():
            known = self._known.get(name)
            if known is None and not (self._folder / name).exists():
                return State.UNKNOWN, f"{name}, which it was made from, is not in the folder"
            if self._hash(name) != digest:
                return State.STALE, f"{name} has changed since"
            if known is not None and known.state is not State.CURRENT:
                return known.state, f"{name} is {known.state}"
        return State.CURRENT, f"from {', '.join(inputs)}"

    def _hash(self, name: str) -> str:
        path = self._folder / name
        if path not in self._hashes:
            self._hashes[path] = sha256_of(path)
        return self._hashes[path]


def _flat(prefix: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Nested parameters by dotted name, as JSON has them."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            flat |= _flat(f"{prefix}.{name}", value)
        else:
            flat[f"{prefix}.{name}"] = list(value) if isinstance(value, tuple) else value
    return flat
