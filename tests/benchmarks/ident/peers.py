"""Identification methods of other packages (see peers.txt), as the benchmark calls them.

Each gets the data without means and scaled to unit variance, the order, no direct feedthrough where it lets one choose,
and a horizon of twice the order; everything else is its default.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from scipy.linalg import solve_discrete_are

Arrays = Any  # numpy arrays, float64
Matrices = tuple[Arrays, Arrays, Arrays, Arrays | None]  # A, B, C and K, None where the package has none


def _slicot(u: Arrays, y: Arrays, order: int, compression: str, system: str) -> Matrices:
    import ctrlsys

    u, y = np.asfortranarray(u), np.asfortranarray(y)
    m, p = u.shape[1], y.shape[1]
    _, factor, _, _, info = ctrlsys.ib01ad(compression, "C", "N", "O", "N", "N", 2 * order, m, p, u, y, 0.0, 0.0)
    if info:
        raise RuntimeError(f"IB01AD: info {info}")
    a, c, b, _, q, r, s, _, _, info = ctrlsys.ib01bd(system, "A", "C", 2 * order, order, m, p, len(u), factor, 0.0)
    if info:
        raise RuntimeError(f"IB01BD: info {info}")
    return a, b, c, _kalman_gain(a, c, q, r, s)


def _kalman_gain(a: Arrays, c: Arrays, q: Arrays, r: Arrays, s: Arrays) -> Arrays | None:
    """By SciPy, because IB01BD's own fails on some data."""
    try:
        variance = solve_discrete_are(a.T, c.T, q, r, s=s)
    except (np.linalg.LinAlgError, ValueError):
        return None
    return np.linalg.solve(c @ variance @ c.T + r, (a @ variance @ c.T + s).T).T


def _sippy(u: Arrays, y: Arrays, order: int, method: str) -> Matrices:
    import sippy_unipi

    horizon = 2 * order
    model = sippy_unipi.system_identification(
        y.T, u.T, method, SS_fixed_order=order, SS_f=horizon, SS_p=horizon, SS_D_required=False
    )
    return model.A, model.B, model.C, model.K


def _nfoursid(u: Arrays, y: Arrays, order: int) -> Matrices:
    import pandas
    from nfoursid.nfoursid import NFourSID

    ins, outs = [f"u{column}" for column in range(u.shape[1])], [f"y{column}" for column in range(y.shape[1])]
    table = pandas.DataFrame(np.hstack([u, y]), columns=[*ins, *outs])
    method = NFourSID(table, outs, ins, num_block_rows=2 * order)
    method.subspace_identification()
    model, _ = method.system_identification(rank=order)
    return model.a, model.b, model.c, None


_METHODS: dict[str, Callable[[Arrays, Arrays, int], Matrices]] = {
    "ctrlsys N4SID": partial(_slicot, compression="N", system="N"),
    "ctrlsys MOESP": partial(_slicot, compression="M", system="M"),
    **{
        f"sippy-unipi {name}": partial(_sippy, method=name)
        for name in ("N4SID", "MOESP", "CVA", "PARSIM-P", "PARSIM-S", "PARSIM-K")
    },
    "nfoursid": _nfoursid,
}
NAMES = tuple(_METHODS)


def identify(name: str, inputs: Arrays, outputs: Arrays, sample_time: float, order: int) -> dict[str, Arrays]:
    """Matrices A, B, C, and K where there is one, of the model in the units of the data."""
    input_scale, output_scale = inputs.std(axis=0), outputs.std(axis=0)
    u, y = (inputs - inputs.mean(axis=0)) / input_scale, (outputs - outputs.mean(axis=0)) / output_scale
    with contextlib.redirect_stdout(io.StringIO()):
        a, b, c, k = _METHODS[name](u, y, order)
    matrices = {"a": np.asarray(a), "b": np.asarray(b) / input_scale, "c": np.asarray(c) * output_scale[:, np.newaxis]}
    return matrices if k is None else matrices | {"k": np.asarray(k) / output_scale}
