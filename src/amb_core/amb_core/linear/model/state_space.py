"""The identified model: a linear system with its noise (innovations form) and its operating point.

    x[k+1] = A x[k] + B (u[k] - input_offset) + K e[k]
    y[k]   = C x[k] + D (u[k] - input_offset) + output_offset + e[k]

u and y are in `input_units` and `output_units`: for a bearing, the control current references (A) and the rotor
position (m); the units below are for this case. e are the innovations, in the units of y.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import IdentificationError
from amb_core.ground.files.arrays import load_arrays
from amb_core.ground.files.file_errors import reading
from amb_core.ground.files.matlab import load_variables, save_variables
from amb_core.ground.files.regular_files import MIB, is_folder, read_text
from amb_core.ground.given_values import number, path_of, whole_number
from amb_core.linear import LinearSystem
from amb_core.linear.model.mat_fields import fields_of, variables_of
from amb_core.linear.system import real_array

_UNITS = {"input_units": "A", "output_units": "m"}  # if a model or an old file names none
_LATER = (*_UNITS, "fingerprint", "search", "undecided")  # fields that old files lack
IN_FOLDER = "model.json"
"""The model in a folder of results."""
LARGEST = 64 * MIB
"""Largest model in JSON that is read; one of order 100 takes about 0.5 MiB."""
_ARRAYS = (
    "a", "b", "c", "d", "k", "innovation_covariance", "input_offset", "output_offset", "initial_state", "fit",
    "fingerprint", "search",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class StateSpaceModel(LinearSystem):
    """State-space model in innovations form, n states, m inputs, p outputs; arrays are read-only.

    As a `LinearSystem` it is its deterministic part, from u - input_offset to y - output_offset.

    Attributes
    ----------
    a, b, c, d : ndarray, shapes (n, n), (n, m), (p, n), (p, m)
        System matrices, in the units of the signals: outputs in m, inputs in A.
    k : ndarray, shape (n, p)
        Kalman gain (1/m).
    innovation_covariance : ndarray, shape (p, p)
        Covariance of e (m^2).
    input_offset, output_offset : ndarray, shapes (m,), (p,)
        Operating point: means of the data (A, m).
    initial_state : ndarray, shape (n,)
        State at the first sample of the data (-).
    sample_time : float
        Sample time (s).
    input_names, output_names : tuple of str
        Names of inputs and outputs.
    method, source : str
        How and from what it was identified.
    samples : int
        Number of samples it was identified from.
    fit : ndarray, shape (p,) or (0,)
        Closed-loop NRMSE fit with the known controller on the data, without the tones that were removed (percent); -inf
        if the closed loop of the model diverges, empty if the model has not been validated.
    input_units, output_units : tuple of str
        Units of inputs and outputs; empty for all inputs in A, all outputs in m.
    fingerprint : ndarray, shape (f,)
        Hashes of samples that it was identified from (-), by which they are recognised; empty where not known.
    search : ndarray, shape (3,) or (0,)
        How the search of the identification ended (-): steps, relative decrease of the squared errors that a further
        step promises, and 1 if it converged; empty where there was none, or it is not known.
    undecided : tuple of str
        What the uncertainty says of poles whose stability the data do not decide, as one text, empty if they decide
        all; no text where there is no uncertainty, or it is not known.

    Raises
    ------
    IdentificationError
        If shapes do not fit together, or a value is not finite or has an imaginary part.
    """

    a: NDArray[np.float64]
    b: NDArray[np.float64]
    c: NDArray[np.float64]
    d: NDArray[np.float64]
    k: NDArray[np.float64]
    innovation_covariance: NDArray[np.float64]
    input_offset: NDArray[np.float64]
    output_offset: NDArray[np.float64]
    initial_state: NDArray[np.float64]
    sample_time: float
    input_names: tuple[str, ...] = ("i_x", "i_y")
    output_names: tuple[str, ...] = ("x", "y")
    method: str = ""
    source: str = ""
    samples: int = 0
    fit: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    input_units: tuple[str, ...] = ()
    output_units: tuple[str, ...] = ()
    fingerprint: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    search: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    undecided: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in _ARRAYS:
            array = real_array(name, getattr(self, name))
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        for kind in ("input", "output"):
            names, units = tuple(getattr(self, f"{kind}_names")), tuple(getattr(self, f"{kind}_units"))
            object.__setattr__(self, f"{kind}_names", names)
            object.__setattr__(self, f"{kind}_units", units or (_UNITS[f"{kind}_units"],) * len(names))
        object.__setattr__(self, "undecided", tuple(self.undecided))
        # A message takes no other numbers than those of Python.
        object.__setattr__(self, "sample_time", number("sample_time", self.sample_time, IdentificationError))
        object.__setattr__(self, "samples", whole_number("samples", self.samples, IdentificationError))
        self._check()

    def unstable_poles(self) -> NDArray[np.complex128]:
        """Poles outside the unit circle, largest magnitude first.

        Returns
        -------
        ndarray of complex, shape (unstable,)
            Poles in the z plane (-).
        """
        poles = self.poles()
        return poles[np.abs(poles) > 1.0]

    def to_json(self) -> dict[str, Any]:
        """The fields of the model as JSON values, without loss.

        Returns
        -------
        dict of str to object
            JSON values by field name.
        """
        return {item.name: _to_json(getattr(self, item.name)) for item in fields(self)}

    @classmethod
    def from_json(cls, content: Any) -> StateSpaceModel:
        """The model that `to_json` wrote; IdentificationError for anything else.

        Parameters
        ----------
        content : object
            JSON values as `to_json` gives them.

        Returns
        -------
        StateSpaceModel
            The model.

        Raises
        ------
        IdentificationError
            If the content is not that of a model.
        """
        names = {item.name for item in fields(cls)}
        if not isinstance(content, dict) or set(content) | set(_LATER) != names:
            present = ", ".join(sorted(content)) if isinstance(content, dict) else type(content).__name__
            raise IdentificationError(f"expected the fields {', '.join(sorted(names))}; found {present}")
        try:
            return cls(**(content | _without_states(content) | {"fit": [float(value) for value in content["fit"]]}))
        except (TypeError, ValueError) as problem:
            raise IdentificationError(str(problem)) from None

    def save(self, path: str | Path) -> None:
        """Write the model as `.json` (readable), `.npz` (NumPy) or `.mat` (MATLAB, Octave); none loses a bit.

        Parameters
        ----------
        path : str or Path
            File to write; its extension gives the format.

        Raises
        ------
        IdentificationError
            If the file name extension is not supported, or the file cannot be written.
        """
        path = path_of("path", path, IdentificationError)
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        try:
            ending = _ending(path)
            if ending == ".npz":
                with path.open("wb") as file:
                    np.savez(file, **values)
            elif ending == ".mat":
                save_variables(path, variables_of(values))
            else:
                path.write_text(json.dumps(self.to_json(), indent=1) + "\n")
        except OSError as problem:
            raise IdentificationError(f"model {path}: cannot be written: {problem.strerror}") from None

    @classmethod
    def load(cls, path: str | Path) -> StateSpaceModel:
        """Read a model that `save` has written, or the matrices of one from elsewhere.

        Parameters
        ----------
        path : str or Path
            File of a format that `save` writes, or a folder of results with a model.json. A `.mat` or `.npz` file may
            hold A, B, C, D, Ts, InputName and OutputName only, as of an `idss` or `ss` of MATLAB.

        Returns
        -------
        StateSpaceModel
            The model, bit for bit as it was saved.

        Raises
        ------
        IdentificationError
            If the file cannot be read or does not contain a model.
        """
        path = path_of("path", path, IdentificationError)
        if is_folder(path):
            path /= IN_FOLDER
        ending = _ending(path)
        with reading("model", path):
            if ending == ".npz":
                arrays = load_arrays(path)
                content: dict[str, Any] = (
                    fields_of(arrays) if "A" in arrays else {name: array.tolist() for name, array in arrays.items()}
                )
            elif ending == ".mat":
                content = fields_of(load_variables(path))
            else:
                content = json.loads(read_text(path, LARGEST))
        try:
            return cls.from_json(content)
        except IdentificationError as problem:
            raise IdentificationError(f"model {path}: {problem}") from None

    def _check(self) -> None:
        n, m, p = len(np.atleast_1d(self.a)), len(self.input_names), len(self.output_names)
        for name, shape in _shapes(n, m, p).items():
            array = getattr(self, name)
            if array.shape != shape:
                raise IdentificationError(
                    f"'{name}' has shape {array.shape}; {shape} is needed for {n} states, {m} inputs and {p} outputs"
                )
            if not np.all(np.isfinite(array)):
                raise IdentificationError(f"'{name}' holds values that are not finite")
        for kind, count in (("input", m), ("output", p)):
            units = getattr(self, f"{kind}_units")
            if len(units) != count:
                raise IdentificationError(f"'{kind}_units' = {units} is not allowed; {count} texts or none are needed")
        if self.fit.shape not in ((p,), (0,)) or np.any(np.isnan(self.fit)):
            raise IdentificationError(f"'fit' = {self.fit.tolist()} is not allowed; {p} numbers or none are needed")
        if self.search.shape not in ((3,), (0,)) or not np.all(np.isfinite(self.search)):
            raise IdentificationError(f"'search' = {self.search.tolist()} is not allowed; 3 numbers or none are needed")
        if len(self.undecided) > 1 or not all(isinstance(text, str) for text in self.undecided):
            raise IdentificationError(f"'undecided' = {self.undecided} is not allowed; one text or none is needed")
        if not (math.isfinite(self.sample_time) and self.sample_time > 0.0):
            raise IdentificationError(f"'sample_time' = {self.sample_time!r} s is not allowed; it must be positive")


def _shapes(n: int, m: int, p: int) -> dict[str, tuple[int, ...]]:
    """Shapes of the arrays of a model with n states, m inputs and p outputs."""
    return {
        "a": (n, n),
        "b": (n, m),
        "c": (p, n),
        "d": (p, m),
        "k": (n, p),
        "innovation_covariance": (p, p),
        "input_offset": (m,),
        "output_offset": (p,),
        "initial_state": (n,),
    }


def _without_states(content: dict[str, Any]) -> dict[str, Any]:
    """The matrices of a model without states, whose columns a list does not keep; nothing for a model with states."""
    if np.size(content["a"]):
        return {}
    shapes = _shapes(0, len(content["input_names"]), len(content["output_names"]))
    return {name: np.zeros(shape) for name, shape in shapes.items() if 0 in shape and not np.size(content[name])}


def _ending(path: Path) -> str:
    ending = path.suffix.lower()
    if ending not in (".json", ".npz", ".mat"):
        raise IdentificationError(f"model {path}: the file name must end in .json, .npz or .mat")
    return ending


def _to_json(value: Any) -> Any:
    """A value in strict JSON, which has no infinity: the fit of a diverged closed loop becomes the text '-inf'."""
    if isinstance(value, np.ndarray) and value.ndim == 1:
        return [number if math.isfinite(number) else str(number) for number in value.tolist()]
    return value.tolist() if isinstance(value, np.ndarray) else value
