"""A model as source text: C99 with a test vector, a python-control script, a Julia script; numbers without loss."""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Mapping
from typing import Any, NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import IdentificationError
from amb_core.ground.extras import extra
from amb_core.linear.control_names import control_names
from amb_core.linear.model import StateSpaceModel

with extra("files"):
    import jinja2

STEPS = 50
"""Steps of the test vector: few, since an unstable model grows."""
SMALLEST_TOLERANCE = 1e-12
"""Error always allowed in the self-check, relative to the largest output."""
ROUNDINGS = 100.0
"""Error allowed in the self-check, in those of rounding to double: compilers and processors round differently."""
_RESERVED = frozenset((
    "auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else", "enum", "extern", "float",
    "for", "goto", "if", "inline", "int", "long", "register", "restrict", "return", "short", "signed", "sizeof",
    "static", "struct", "switch", "typedef", "union", "unsigned", "void", "volatile", "while",
    "advance", "check", "expected", "innovation", "inputs", "main", "magnitude", "measured", "next", "predicted",
))  # fmt: skip


class Vector(NamedTuple):
    """What a model does from rest at its operating point.

    Attributes
    ----------
    inputs : ndarray, shape (steps, m)
        Inputs.
    outputs : ndarray, shape (steps, p)
        Outputs of the model alone.
    measured : ndarray, shape (steps, p)
        Outputs that a predictor is given.
    predicted : ndarray, shape (steps, p)
        Outputs of the model as predictor, with its Kalman gain.
    rounding : float
        Error of these outputs by rounding to double, relative to the largest one.
    """

    inputs: NDArray[np.float64]
    outputs: NDArray[np.float64]
    measured: NDArray[np.float64]
    predicted: NDArray[np.float64]
    rounding: float


def vector_of(model: StateSpaceModel, steps: int = STEPS) -> Vector:
    """Outputs of a model for random inputs of one unit about the operating point, always the same.

    They are computed in the order of the C code, so that this gives the same bits.
    """
    random = np.random.default_rng(1)
    inputs = model.input_offset + random.normal(size=(steps, len(model.input_names)))
    noise = random.normal(size=(steps, len(model.output_names))) * np.sqrt(np.diag(model.innovation_covariance))
    measured = model.output_offset + noise
    errors, responses = [], []
    for followed in (None, measured):
        responses.append(_response(model, inputs, followed, np.float64))
        exact = _response(model, inputs, followed, np.longdouble)
        errors.append(np.abs(responses[-1] - exact).max() / np.abs(exact).max())
    return Vector(inputs, responses[0], measured, responses[1], float(np.nanmax([0.0, *errors])))


def c_texts(model: StateSpaceModel, name: str) -> dict[str, str]:
    """The files of the model in C99, by their names: header, code, and a check with a test vector.

    Parameters
    ----------
    model : StateSpaceModel
        The model.
    name : str
        What files, types and functions are named after, see `identifier`.

    Raises
    ------
    IdentificationError
        If the model has no states.
    """
    if not model.order:
        raise IdentificationError("a model without states cannot be exported as code")
    vector = vector_of(model)
    tolerance = max(SMALLEST_TOLERANCE, ROUNDINGS * vector.rounding)
    values = _values(model, name) | {"steps": STEPS, "tolerance": f"{tolerance:.1g}"}
    rows = {field: _rows(array) for field, array in vector._asdict().items() if isinstance(array, np.ndarray)}
    return {
        f"{name}.h": rendered("model.h.j2", values),
        f"{name}.c": rendered("model.c.j2", values),
        f"{name}_check.c": rendered("model_check.c.j2", values | {"vector": rows}),
    }


def python_text(model: StateSpaceModel) -> str:
    """A script that makes the model with python-control."""
    return rendered("model.py.j2", _values(model, "model"))


def julia_text(model: StateSpaceModel) -> str:
    """A script that makes the model with ControlSystems.jl."""
    return rendered("model.jl.j2", _values(model, "model"))


def identifier(text: str) -> str:
    """A name for functions and files in C from any text: small letters, digits and underscores."""
    word = re.sub(r"_+", "_", re.sub(r"[^a-z0-9]", "_", text.lower())).strip("_") or "model"
    return f"model_{word}" if word[0].isdigit() or word in _RESERVED else word


def title_of(model: StateSpaceModel) -> str:
    """What the model is, in one line of plain letters that ends no comment."""
    text = f"Model of order {model.order}"
    text += f", method {model.method}" if model.method else ""
    text += f", identified from {model.source}" if model.source else ""
    line = "".join(letter if letter.isprintable() and letter not in '\\"' else " " for letter in text)
    return line.replace("*/", "* /").replace("/*", "/ *") + "."


def rendered(template: str, values: Mapping[str, Any]) -> str:
    """A template of this folder with values."""
    return _templates().get_template(template).render(values)


@functools.cache
def _templates() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("amb_core.recording.export"),
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=jinja2.StrictUndefined,
        autoescape=False,
    )
    environment.filters["quoted"] = quoteattr
    environment.filters["columnwise"] = lambda rows: [number for column in zip(*rows, strict=True) for number in column]
    return environment


def _values(model: StateSpaceModel, name: str) -> dict[str, Any]:
    """What templates show of a model; numbers as texts that are read back bit for bit."""
    matrices = {"A": model.a, "B": model.b, "C": model.c, "D": model.d, "K": model.k}
    texts = {
        "input_names": model.input_names,
        "input_units": model.input_units,
        "output_names": model.output_names,
        "output_units": model.output_units,
    }
    return {
        "name": name,
        "NAME": name.upper(),
        "title": title_of(model),
        "sample_time": repr(model.sample_time),
        "n": model.order,
        "m": len(model.input_names),
        "p": len(model.output_names),
        "inputs": _described(model.input_names, model.input_units),
        "outputs": _described(model.output_names, model.output_units),
        "matrices": [(label, *array.shape, _rows(array)) for label, array in matrices.items()],
        "input_offset": _numbers(model.input_offset),
        "output_offset": _numbers(model.output_offset),
        "control_inputs": _control_names("input_names", model.input_names),
        "control_outputs": _control_names("output_names", model.output_names),
        **{key: repr(list(value)) for key, value in texts.items()},
        **{f"{key}_julia": _julia_texts(value) for key, value in texts.items()},
    }


def _control_names(variable: str, names: tuple[str, ...]) -> str:
    """What python-control is given as names: the variable of the script that holds them where it takes those."""
    taken = control_names(names)
    return variable if taken == list(names) else repr(taken)


def _described(names: tuple[str, ...], units: tuple[str, ...]) -> str:
    text = ", ".join(f"{name} [{unit}]" if unit else name for name, unit in zip(names, units, strict=True))
    return "".join(letter if letter.isprintable() and letter not in "*\\" else " " for letter in text)


def _julia_texts(words: tuple[str, ...]) -> str:
    """A list of texts in Julia, where a dollar sign would begin a variable."""
    return "[" + ", ".join(json.dumps(word).replace("$", "\\$") for word in words) + "]"


def _rows(array: NDArray[np.float64]) -> list[list[str]]:
    return [_numbers(row) for row in array]


def _numbers(values: NDArray[np.float64]) -> list[str]:
    return [repr(value) for value in values.tolist()]


def _response(
    model: StateSpaceModel, inputs: NDArray[np.float64], measured: NDArray[np.float64] | None, kind: type[Any]
) -> NDArray[Any]:
    """Outputs from rest, with measured outputs those of the predictor; sums from left to right, in one type."""
    a, b, c, d, k = (array.astype(kind) for array in (model.a, model.b, model.c, model.d, model.k))
    input_offset, output_offset = model.input_offset.astype(kind), model.output_offset.astype(kind)
    state = np.zeros(model.order, dtype=kind)
    outputs = np.empty((len(inputs), len(output_offset)), dtype=kind)
    for step, given in enumerate(inputs.astype(kind)):
        values = given - input_offset
        outputs[step] = _summed((c, state), (d, values)) + output_offset
        innovation = [] if measured is None else [(k, measured[step].astype(kind) - outputs[step])]
        state = _summed((a, state), (b, values), *innovation)
    return outputs


def _summed(*products: tuple[NDArray[Any], NDArray[Any]]) -> NDArray[Any]:
    """The sum of products of matrices and vectors, each row from its first term to its last, as a loop in C adds."""
    terms = np.concatenate([matrix * vector for matrix, vector in products], axis=1)
    return np.add.accumulate(terms, axis=1)[:, -1]
