"""A ROSS rotor from a file that ROSS saved, or from a Python function that makes one."""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

from amb_core.ground.errors import PlantError
from amb_core.ground.files.regular_files import read_text, shown

SAVED = (".toml", ".json")
"""Endings of the files that `ross.Rotor.save` writes."""
HOW_TO_ADD = "make setup EXTRAS=ross (or: pip install ross-rotordynamics==2.3.0 'plotly<7')"
_NEEDED = ("M0", "K0", "G0", "nodes", "nodes_pos", "number_dof", "ndof", "shaft_elements", "tag")


def ross_rotor(source: str) -> Any:
    """Load a ROSS rotor.

    Parameters
    ----------
    source : str
        A file of `ross.Rotor.save` (.toml, .json); or `MODULE:FUNCTION` or `FILE.py:FUNCTION`, a function without
        arguments that returns the rotor, for example `ross:rotor_example`.

    Raises
    ------
    PlantError
        If ROSS is not installed, the file cannot be read, or the function fails or returns something else; one line
        with the reason.
    """
    if source.lower().endswith(SAVED):
        return _saved(Path(source))
    place, colon, name = source.rpartition(":")
    if not (colon and place and name):
        raise PlantError(
            f"ROSS rotor '{source}': needed: a file of ross.Rotor.save ({', '.join(SAVED)}), or a function that makes "
            "the rotor, as MODULE:FUNCTION or FILE.py:FUNCTION"
        )
    return _made(source, place, name)


def _saved(path: Path) -> Any:
    try:
        read_text(path)
    except OSError as problem:
        raise PlantError(f"ROSS rotor {shown(path)}: cannot be read: {problem.strerror}") from None
    with _one_line(f"ROSS rotor {path}"):
        return _imported("ross").Rotor.load(path)


def _made(source: str, place: str, name: str) -> Any:
    with _one_line(f"ROSS rotor {source}"):
        module = _module_of_file(Path(place)) if place.endswith(".py") else _imported(place)
        make: Callable[[], Any] | None = getattr(module, name, None)
        if not callable(make):
            raise PlantError(f"ROSS rotor {source}: {place} has no function '{name}'")
        rotor = make()
        if missing := [attribute for attribute in _NEEDED if not hasattr(rotor, attribute)]:
            raise PlantError(
                f"ROSS rotor {source}: the function returns a {type(rotor).__name__} without {', '.join(missing)}; "
                "needed: a ross.Rotor"
            )
        return rotor


@contextlib.contextmanager
def _one_line(what: str) -> Iterator[None]:
    """Any error of ROSS or of the user's code as a PlantError of one line."""
    try:
        yield
    except PlantError:
        raise
    except ModuleNotFoundError as problem:
        if problem.name == "ross":
            raise PlantError(f"{what}: ROSS is not installed; add it with {HOW_TO_ADD}") from None
        raise PlantError(f"{what}: there is no module '{problem.name}'") from None
    except Exception as problem:  # ROSS and the code of users raise anything
        reason = " ".join(str(problem).split()) or type(problem).__name__
        raise PlantError(f"{what}: cannot be made into a rotor: {type(problem).__name__}: {reason}") from None


def _imported(name: str) -> ModuleType:
    if name == "ross" or name.startswith("ross."):
        with _silent_output():
            return importlib.import_module(name)
    sys.path.insert(0, os.getcwd())  # noqa: PTH109  # modules beside the user, as `python -m` finds them
    try:
        return importlib.import_module(name)
    finally:
        sys.path.pop(0)


def _module_of_file(path: Path) -> ModuleType:
    if not path.is_file():
        raise PlantError(f"ROSS rotor {shown(path)}: cannot be read: no such file")
    specification = importlib.util.spec_from_file_location(path.stem, path)
    if specification is None or specification.loader is None:
        raise PlantError(f"ROSS rotor {shown(path)}: is not a Python module")
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@contextlib.contextmanager
def _silent_output() -> Iterator[None]:
    """Without what libraries of ROSS write to the output when they do not find a program for gas properties.

    They write from compiled code, past sys.stdout, so the file descriptors are redirected.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    with open(os.devnull, "w") as nothing:  # noqa: PTH123
        kept = [os.dup(descriptor) for descriptor in (1, 2)]
        try:
            for descriptor in (1, 2):
                os.dup2(nothing.fileno(), descriptor)
            yield
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            for descriptor, before in zip((1, 2), kept, strict=True):
                os.dup2(before, descriptor)
                os.close(before)
