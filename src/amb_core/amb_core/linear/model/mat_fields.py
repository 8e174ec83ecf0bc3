"""A model as the variables of a MATLAB or Octave file, or of a NumPy archive with the same names.

In MATLAB, `idss(A, B, C, D, K, X0, Ts, 'NoiseVariance', NoiseVariance, 'InputName', InputName, 'OutputName',
OutputName)` has the model; in Octave, `ss(A, B, C, D, Ts)` has its deterministic part.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from amb_core.ground.errors import IdentificationError
from amb_core.ground.files.matlab import cell, texts

_MATRICES = {"a": "A", "b": "B", "c": "C", "d": "D", "k": "K", "innovation_covariance": "NoiseVariance"}
_VECTORS = {
    "input_offset": "InputOffset",
    "output_offset": "OutputOffset",
    "initial_state": "X0",
    "fit": "Fit",
    "fingerprint": "Fingerprint",
    "search": "Search",
}
_NAMES = {
    "input_names": "InputName",
    "output_names": "OutputName",
    "input_units": "InputUnit",
    "output_units": "OutputUnit",
    "undecided": "Undecided",
}
_NEEDED = ("A", "B", "C", "D", "Ts", "InputName", "OutputName")
_TEXTS = {"method": "Method", "source": "Source"}


def variables_of(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Variables by their name in MATLAB from the fields of a model; vectors are columns."""
    return {
        **{matlab: fields[name] for name, matlab in _MATRICES.items()},
        **{matlab: fields[name][:, np.newaxis] for name, matlab in _VECTORS.items()},
        **{matlab: cell(fields[name]) for name, matlab in _NAMES.items()},
        **{matlab: cell([fields[name]]) for name, matlab in _TEXTS.items()},
        "Ts": fields["sample_time"],
        "Samples": float(fields["samples"]),
    }


def fields_of(variables: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a model from variables of `variables_of`, or from those of a MATLAB `idss` or, without K, `ss`.

    Raises
    ------
    IdentificationError
        If one is missing that has no default.
    """
    missing = [name for name in _NEEDED if name not in variables]
    if missing:
        present = ", ".join(sorted(variables)) or "nothing"
        raise IdentificationError(
            f"lacks {', '.join(missing)}; a model is {', '.join(_NEEDED)}, such as those of an idss, which has K too; "
            f"found {present}"
        )
    variables = dict(variables) | {name: np.atleast_2d(variables[name]) for name in "ABCD"}
    inputs, outputs, states = (variables[name].shape[axis] for name, axis in (("B", 1), ("C", 0), ("A", 0)))
    values = {
        "k": np.zeros((states, outputs)),
        "innovation_covariance": np.zeros((outputs, outputs)),
        "input_offset": np.zeros(inputs),
        "output_offset": np.zeros(outputs),
        "initial_state": np.zeros(states),
        "fit": np.empty(0),
        "fingerprint": np.empty(0),
        "search": np.empty(0),
        "undecided": (),
        "method": "",
        "source": "",
        "sample_time": float(variables["Ts"].item()),
        "samples": int(variables["Samples"].item()) if "Samples" in variables else 0,
    }
    kinds = (
        (_MATRICES, lambda value: value),
        (_VECTORS, np.ravel),
        (_NAMES, texts),
        (_TEXTS, lambda value: texts(value)[0]),
    )
    for names, convert in kinds:
        values |= {name: convert(variables[matlab]) for name, matlab in names.items() if matlab in variables}
    return values
