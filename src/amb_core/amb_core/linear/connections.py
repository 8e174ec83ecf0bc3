"""Connections of linear systems: in series, in parallel, beside one another, and in the loop of a control law."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import block_diag

from amb_core.ground.sample_times import same_sample_time
from amb_core.linear.system import LinearSystem


def series(first: LinearSystem, second: LinearSystem) -> LinearSystem:
    """The second system driven by the outputs of the first."""
    _require_alike(first, second, first.outputs == second.inputs)
    return LinearSystem(
        np.block([[first.a, np.zeros((first.order, second.order))], [second.b @ first.c, second.a]]),
        np.vstack([first.b, second.b @ first.d]),
        np.hstack([second.d @ first.c, second.c]),
        second.d @ first.d,
        first.sample_time,
        first.input_names, second.output_names, first.input_units, second.output_units, _states(first, second),
    )  # fmt: skip


def parallel(first: LinearSystem, second: LinearSystem) -> LinearSystem:
    """Both driven by the same inputs, their outputs added; the signals have the names of the first."""
    _require_alike(first, second, first.d.shape == second.d.shape)
    return LinearSystem(
        block_diag(first.a, second.a), np.vstack([first.b, second.b]), np.hstack([first.c, second.c]),
        first.d + second.d, first.sample_time,
        first.input_names, first.output_names, first.input_units, first.output_units, _states(first, second),
    )  # fmt: skip


def beside(first: LinearSystem, second: LinearSystem) -> LinearSystem:
    """Two systems that do not act on each other as one, inputs and outputs of the first first."""
    _require_alike(first, second, True)
    a, b, c, d = (block_diag(getattr(first, name), getattr(second, name)) for name in "abcd")
    return LinearSystem(
        a, b, c, d, first.sample_time,
        _both(first.input_names, second.input_names), _both(first.output_names, second.output_names),
        _both(first.input_units, second.input_units), _both(first.output_units, second.output_units),
        _states(first, second),
    )  # fmt: skip


def feedback(plant: LinearSystem, law: LinearSystem, references: int = 0) -> LinearSystem:
    """A plant in the loop of a control law: u = law of (r, y) + w_u, y = C x + w_y.

    The outputs of the law drive the first inputs u of the plant; its last inputs are the first outputs y of the plant.
    Negative feedback is in the law. Further inputs and outputs of the plant stay open.

    Parameters
    ----------
    plant : LinearSystem
        Without direct feedthrough.
    law : LinearSystem
        From (r, y) to u.
    references : int, optional
        Number of references r.

    Returns
    -------
    LinearSystem
        From (r, w_u, w_y, further inputs) to (u, y, further outputs); its states are those of plant and law.
    """
    m, p, r = law.outputs, law.inputs - references, references
    _require_alike(plant, law, m <= plant.inputs and 0 <= p <= plant.outputs and not np.any(plant.d))
    (n, k), (e, s) = (plant.order, law.order), (plant.inputs - m, plant.outputs - p)
    (b_r, b_y), (d_r, d_y) = (np.split(matrix, [r], axis=1) for matrix in (law.b, law.d))
    c, total = plant.c[:p], r + m + p + e
    current = np.hstack([d_y @ c, law.c])  # u by the states
    a = np.block([[plant.a, np.zeros((n, k))], [b_y @ c, law.a]])
    a[:n] += plant.b[:, :m] @ current
    into_u = np.hstack([d_r, np.eye(m), d_y, np.zeros((m, e))])
    into_y = np.eye(p, total, r + m)
    b = np.vstack([plant.b[:, :m] @ into_u, np.hstack([b_r, np.zeros((k, m)), b_y, np.zeros((k, e))])])
    b[:n, r + m + p :] += plant.b[:, m:]
    seen = np.hstack([plant.c, np.zeros((p + s, k))])
    names = plant.input_names, plant.output_names
    into = _both(law.input_names[:r], [f"w_{name}" for name in (*names[0][:m], *names[1][:p])], names[0][m:])
    return LinearSystem(
        a, b, np.vstack([current, seen]), np.vstack([into_u, into_y, np.zeros((s, total))]), plant.sample_time,
        into if len(into) == total else (), _both(names[0][:m], names[1]), state_names=_states(plant, law),
    )  # fmt: skip


def _require_alike(first: LinearSystem, second: LinearSystem, fitting: bool) -> None:
    if not fitting or not same_sample_time(second.sample_time, first.sample_time):
        raise ValueError(
            f"systems of {first.inputs} inputs, {first.outputs} outputs, {first.sample_time:g} s, and of "
            f"{second.inputs} inputs, {second.outputs} outputs, {second.sample_time:g} s do not fit together, or the "
            "plant of a loop has direct feedthrough"
        )


def _states(first: LinearSystem, second: LinearSystem) -> tuple[str, ...]:
    names = _both(first.state_names, second.state_names)
    return names if len(names) == first.order + second.order else ()


def _both(*names: Sequence[str]) -> tuple[str, ...]:
    return tuple(name for part in names for name in part)
