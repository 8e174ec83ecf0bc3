"""Linear controllers from elsewhere: the matrices of a file, as MATLAB has them, or a system of python-control.

A file holds A, B, C, D and Ts, in MATLAB `[A, B, C, D, Ts] = ssdata(K); save K.mat A B C D Ts`, or a whole model as
`StateSpaceModel.save` writes one.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import IdentificationError, ParameterError
from amb_core.ground.files.arrays import load_arrays
from amb_core.ground.files.file_errors import reading
from amb_core.ground.files.matlab import load_variables
from amb_core.ground.files.regular_files import read_text
from amb_core.ground.given_values import path_of
from amb_core.linear import LinearSystem
from amb_core.linear.model import StateSpaceModel
from amb_core.linear.model.state_space import LARGEST

if TYPE_CHECKING:
    import control

_MATRICES = ("a", "b", "c", "d")
_SAMPLE_TIME = ("ts", "dt", "sample_time")
_OF_A_MODEL = {"innovation_covariance", "noisevariance"}  # which every saved model has
_SAMPLED = "sample it first, in MATLAB by c2d(K, Ts, 'tustin'), in python-control by control.c2d(K, Ts, 'tustin')"


def load_controller(path: str | Path) -> StateSpaceModel:
    """The linear controller of a file.

    Parameters
    ----------
    path : str or Path
        A `.json`, `.npz` or `.mat` file, of a model that was saved, or of the matrices A, B, C, D and the sample time
        Ts (s), also named `dt` or `sample_time`; capitals or not. Inputs are the position errors r - y of all axes, or
        their references and then their positions (m); outputs are currents (A). An optional K is the anti-windup gain.
        Other variables do not matter.

    Returns
    -------
    StateSpaceModel
        The controller, as `LinearController` takes it.

    Raises
    ------
    IdentificationError
        If the file cannot be read or holds no controller.
    """
    path = path_of("path", path, IdentificationError)
    if path.suffix.lower() not in (".json", ".npz", ".mat"):
        return StateSpaceModel.load(path)  # whose error names the endings
    with reading("model", path):
        content = _content(path)
        if isinstance(content, Mapping) and not _OF_A_MODEL & {name.lower() for name in content}:
            return _of_matrices({name: value for name, value in content.items() if value is not None})
    return StateSpaceModel.load(path)


def controller_from(system: LinearSystem | control.StateSpace) -> StateSpaceModel:
    """A controller that was designed in Python, as a model that `LinearController` takes and `save` writes.

    Parameters
    ----------
    system : LinearSystem or control.StateSpace
        In discrete time, from the position errors r - y of all axes, or their references and then their positions (m),
        to currents (A).

    Returns
    -------
    StateSpaceModel
        The same matrices and sample time.

    Raises
    ------
    ParameterError
        If it is no such system, or one of continuous time.
    """
    if not isinstance(system, LinearSystem):
        if not all(hasattr(system, name) for name in (*"ABCD", "dt")):
            raise ParameterError(
                f"controller: {type(system).__name__} is not allowed; allowed: a LinearSystem, or a state-space system "
                "of python-control (control.ss)"
            )
        if system.dt is True:
            raise ParameterError(
                "the sample time of the controller is not known; give it to control.ss(A, B, C, D, Ts)"
            )
        system = LinearSystem.from_control(system)
    if not system.sample_time > 0.0:
        raise ParameterError(f"the controller is one of continuous time; {_SAMPLED}")
    return _model(dict(zip(_MATRICES, (system.a, system.b, system.c, system.d), strict=True)), system.sample_time)


def _content(path: Path) -> Any:
    ending = path.suffix.lower()
    if ending == ".npz":
        return load_arrays(path)
    return load_variables(path) if ending == ".mat" else json.loads(read_text(path, LARGEST))


def _of_matrices(content: Mapping[str, Any]) -> StateSpaceModel:
    """The controller of a file without noise, offsets and names."""
    by_name: dict[str, list[str]] = {}
    for name in content:
        by_name.setdefault(name.lower(), []).append(name)
    wanted = {name: by_name.get(name, []) for name in (*_MATRICES, "k")}
    wanted["ts"] = [name for known in _SAMPLE_TIME for name in by_name.get(known, [])]
    twice = next((names for names in wanted.values() if len(names) > 1), None)
    if twice:
        raise IdentificationError(f"has {' and '.join(twice)}; allowed: one of them")
    missing = [name.capitalize() for name, names in wanted.items() if not names and name != "k"]
    if missing:
        present = ", ".join(sorted(content)) or "nothing"
        raise IdentificationError(
            f"lacks {', '.join(missing)}; a controller is A, B, C, D and its sample time Ts (s), or what "
            f"StateSpaceModel.save writes; found {present}"
        )
    values = {name: _numbers(names[0], content[names[0]]) for name, names in wanted.items() if names}
    if values["ts"].size != 1 or not values["ts"].item() > 0.0:
        raise IdentificationError(
            f"'{wanted['ts'][0]}' = {content[wanted['ts'][0]]} is not allowed; it must be the sample time in s: of a "
            f"controller of continuous time there is none, {_SAMPLED}"
        )
    return _model(values, values.pop("ts").item())


def _numbers(name: str, value: Any) -> NDArray[np.float64]:
    try:
        array = np.asarray(value)
        if not np.can_cast(array.dtype, np.float64, "same_kind"):
            raise ValueError
    except ValueError:  # rows of different lengths, texts, complex numbers
        raise IdentificationError(f"'{name}' is no matrix of real numbers") from None
    return array.astype(np.float64)


def _model(values: Mapping[str, NDArray[np.float64]], sample_time: float) -> StateSpaceModel:
    """A model without noise and offsets; wrong shapes raise IdentificationError there."""
    a, d = (np.atleast_2d(values[name]) for name in "ad")
    p, m = d.shape
    n = len(a) if a.size else 0
    inputs = [f"r_{axis}" for axis in range(p)] + [f"y_{axis}" for axis in range(p)]
    return StateSpaceModel(
        a=_shaped(a, n, n), b=_shaped(values["b"], n, m), c=_shaped(values["c"], p, n), d=d,
        k=_shaped(values["k"], n, p) if "k" in values else np.zeros((n, p)),
        innovation_covariance=np.zeros((p, p)), input_offset=np.zeros(m), output_offset=np.zeros(p),
        initial_state=np.zeros(n), sample_time=sample_time,
        input_names=tuple(inputs if m == 2 * p else (f"e_{number}" for number in range(m))),
        output_names=tuple(f"i_{axis}" for axis in range(p)), input_units=("m",) * m, output_units=("A",) * p,
    )  # fmt: skip


def _shaped(array: NDArray[np.float64], rows: int, columns: int) -> NDArray[np.float64]:
    """A vector, or an empty matrix, as the matrix that it stands for; others as they are."""
    free = array.ndim < 2 or not array.size
    return array.reshape(rows, columns) if free and array.size == rows * columns else np.atleast_2d(array)
