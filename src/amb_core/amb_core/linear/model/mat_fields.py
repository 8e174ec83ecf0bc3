"""A model as the variables of a MATLAB or Octave file.

In MATLAB, `idss(A, B, C, D, K, X0, Ts, 'NoiseVariance', NoiseVariance, 'InputName', InputName, 'OutputName',
OutputName)` has the model; in Octave, `ss(A, B, C, D, Ts)` has its deterministic part.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from amb_core.ground.files.matlab import cell, texts

_MATRICES = {"a": "A", "b": "B", "c": "C", "d": "D", "k": "K", "innovation_covariance": "NoiseVariance"}
_VECTORS = {"input_offset": "InputOffset", "output_offset": "OutputOffset", "initial_state": "X0", "fit": "Fit"}
_FINGERPRINT = "Fingerprint"  # which old files lack
_NAMES = {
    "input_names": "InputName",
    "output_names": "OutputName",
    "input_units": "InputUnit",
    "output_units": "OutputUnit",
}
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
        _FINGERPRINT: fields["fingerprint"][:, np.newaxis],
    }


def fields_of(variables: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a model from variables of `variables_of`; KeyError where one is missing."""
    return {
        **{name: variables[matlab] for name, matlab in _MATRICES.items()},
        **{name: variables[matlab].ravel() for name, matlab in _VECTORS.items()},
        **{name: texts(variables[matlab]) for name, matlab in _NAMES.items()},
        **{name: texts(variables[matlab])[0] for name, matlab in _TEXTS.items()},
        "sample_time": float(variables["Ts"].item()),
        "samples": int(variables["Samples"].item()),
        "fingerprint": variables[_FINGERPRINT].ravel() if _FINGERPRINT in variables else np.empty(0),
    }
