"""Real data from a closed loop: the arm of a compact disc player, from the DaISy database; optional.

Two inputs (forces of the actuators), two outputs (tracking errors), 2048 samples. Models are identified from the first
half and judged on the second. The arm answers within the sample, which models without direct feedthrough cannot, so
every method gets the outputs one sample later.

Source: B. De Moor (ed.), DaISy: Database for the Identification of Systems, KU Leuven, data set 96-007.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat

from amb_core.identification import nrmse_fit
from amb_core.identification.estimate.predictor import innovations

FILE = "CD_player_arm_dat.mat"
ORDER = 16  # the first minimum of BIC with PEM

Arrays = NDArray[np.float64]
Half = tuple[Arrays, Arrays]


@dataclass(frozen=True)
class RealData:
    """Inputs and outputs of both halves, about the means of the first."""

    first_half: Half
    second_half: Half


def find(root: Path) -> Path | None:
    """The file in the `data` folder of the checkout or of a folder beside it; None where there is none."""
    return next(iter([*root.glob(f"data/{FILE}"), *root.parent.glob(f"*/data/{FILE}")]), None)


def load(path: Path) -> RealData:
    """Both halves."""
    samples = next(value for name, value in loadmat(path).items() if not name.startswith("__")).astype(float)
    half = len(samples) // 2
    samples = samples - samples[:half].mean(axis=0)
    first, second = samples[:half], samples[half:]
    return RealData((first[1:, :2], first[:-1, 2:]), (second[1:, :2], second[:-1, 2:]))


def score(matrices: tuple[Arrays, Arrays, Arrays], k: Arrays | None, data: RealData) -> dict[str, float]:
    """NRMSE fits of the worse output on the second half (percent).

    fit_simulation is that of the simulated output from the best first state; -inf where it diverges. fit_prediction, of
    models that have a gain K, is that of the one-step prediction.
    """
    a, b, c = matrices
    inputs, outputs = data.second_half
    scores = {"fit_simulation": _fit(a, b, c, np.zeros((len(a), len(c))), inputs, outputs)}
    if k is not None:
        scores["fit_prediction"] = _fit(a, b, c, k, inputs, outputs)
    return scores


def _fit(a: Arrays, b: Arrays, c: Arrays, k: Arrays, inputs: Arrays, outputs: Arrays) -> float:
    with np.errstate(all="ignore"):
        errors = innovations(a, b, c, k, np.zeros(len(a)), inputs, outputs)
        decay, state = np.empty((*outputs.shape, len(a))), np.eye(len(a))
        for step in range(len(decay)):
            decay[step], state = c @ state, (a - k @ c) @ state
        if not (np.all(np.isfinite(decay)) and np.all(np.isfinite(errors))):
            return -np.inf
        first_state = np.linalg.lstsq(decay.reshape(-1, len(a)), errors.ravel())[0]
        return float(nrmse_fit(outputs, outputs - errors + decay @ first_state).min())
