"""Checks of whether the data can determine a model of an order: enough samples, independent and rich inputs."""

from __future__ import annotations

import math

import numpy as np
from scipy import linalg

from amb_core.data.experiments.checks.lagged import pieces, rows_of, triangle_of
from amb_core.data.experiments.checks.report import Finding, Severity
from amb_core.data.experiments.dataset import IdentificationData

_PER_PARAMETER = 10  # values for each parameter, below which estimates are poor
_COLLINEAR = 1e-6  # smallest singular value of inputs of unit variance that can be separated
_NEARLY_COLLINEAR = 0.05
_STILL = 1e-9  # movement of a reference relative to that of the others; smaller ones are rounding
_EXCITED = 1e-6  # singular value of the lagged inputs, relative to the largest: excitation 120 dB below the strongest


def check_amount(data: IdentificationData, order: int) -> Finding:
    """Compares the number of samples with what a model of the order needs.

    An innovations form of order n with m inputs and p outputs has n (m + 2 p) parameters (D = 0). A subspace estimate
    needs as many rows of its data matrix as columns, for a past of n / p + 1 and a future of 2 n steps.

    Parameters
    ----------
    data : IdentificationData
        Data of any plant.
    order : int
        Number of states of the model.

    Returns
    -------
    Finding
        An error if the samples are too few, a warning if they are few.
    """
    m, p = len(data.input_names), len(data.output_names)
    horizon = math.ceil(order / p) + 2 * order + 2
    columns = (m + p) * horizon
    rows = sum(max(0, item.steps - horizon + 1) for item in data.experiments)
    parameters = order * (m + 2 * p)
    short = [index for index, item in enumerate(data.experiments) if item.steps < horizon]
    if rows < columns:
        return Finding(
            "amount",
            Severity.ERROR,
            f"{data.samples} samples are too few for order {order}; at least {columns + horizon - 1} are needed",
            advice="record longer, or ask for a lower order",
        )
    if data.samples * p < _PER_PARAMETER * parameters:
        return Finding(
            "amount",
            Severity.WARNING,
            f"{data.samples} samples of {p} outputs for {parameters} parameters of order {order}",
            advice=f"record at least {math.ceil(_PER_PARAMETER * parameters / p)} samples, or ask for a lower order",
        )
    if short:
        return Finding(
            "amount",
            Severity.WARNING,
            f"{len(short)} of {len(data.experiments)} experiments have fewer than {horizon} samples and add little",
            f"experiment {short[0]}" + (" ..." if len(short) > 1 else ""),
            "leave them out with subset",
        )
    return Finding("amount", Severity.INFO, f"{data.samples} samples for {parameters} parameters of order {order}")


def check_inputs(data: IdentificationData) -> Finding:
    """Inputs that do not move or are linearly dependent; references that do not move.

    Under feedback every input moves. If its reference does not move, it responds to noise and the other axes only.

    Parameters
    ----------
    data : IdentificationData
        Data with finite values.

    Returns
    -------
    Finding
        The inputs and references at fault.
    """
    if constant := _constant_inputs(data):
        return Finding(
            "inputs",
            Severity.ERROR,
            "constant",
            ", ".join(constant),
            "excite every input, or leave it out of --inputs (in Python: select)",
        )
    factor, rows = triangle_of(u for u, _ in pieces(data, 0))
    _, strengths, directions = linalg.svd(factor / math.sqrt(rows))
    if strengths[-1] < _NEARLY_COLLINEAR:
        weights = directions[-1] / np.abs(directions[-1]).max()
        names = [name for name, weight in zip(data.input_names, weights, strict=True) if abs(weight) > 0.1]
        refused = strengths[-1] < _COLLINEAR
        return Finding(
            "inputs",
            Severity.ERROR if refused else Severity.WARNING,
            "one is a sum of multiples of the others"
            if refused
            else f"nearly a sum of multiples of each other, but for {100.0 * strengths[-1]:.1g} %",
            ", ".join(names),
            "excite them one after another, or with independent signals",
        )
    if still := _still_references(data):
        return Finding(
            "inputs",
            Severity.WARNING,
            "the reference does not move: noise and coupling alone excite this axis",
            ", ".join(still),
            "excite every axis, one after another or with independent signals",
        )
    return Finding("inputs", Severity.INFO, f"{len(data.input_names)} independent inputs")


def _still_references(data: IdentificationData) -> list[str]:
    """Outputs whose reference is known and constant in every experiment."""
    references = [item.reference for item in data.experiments if item.reference is not None]
    if len(references) < len(data.experiments):
        return []
    moves = np.max([np.ptp(reference, axis=0) for reference in references], axis=0)
    return [name for name, move in zip(data.output_names, moves, strict=True) if move <= _STILL * moves.max()]


def _constant_inputs(data: IdentificationData) -> list[str]:
    return [
        name
        for column, name in enumerate(data.input_names)
        if all(np.ptp(item.inputs[:, column]) == 0.0 for item in data.experiments)
    ]


def check_excitation(data: IdentificationData, order: int) -> Finding:
    """Compares the order of persistent excitation of the inputs with the order of the model.

    Inputs are persistently exciting of order L if the matrix of L lagged inputs has full rank. Order 2 n is enough for
    any model of order n; with p outputs that share its states evenly 2 n / p is enough. Noise that feedback adds to
    the inputs counts.

    Parameters
    ----------
    data : IdentificationData
        Data with finite values.
    order : int
        Number of states of the model.

    Returns
    -------
    Finding
        An error if the inputs excite too little for the order, a warning if hardly enough.

    References
    ----------
    L. Ljung, System Identification, 2nd edition, 1999, section 13.2.
    """
    if constant := _constant_inputs(data):
        return Finding("excitation", Severity.INFO, f"not checked: constant inputs {', '.join(constant)}")
    p = len(data.output_names)
    wanted, least = 2 * order, 2 * math.ceil(order / p)
    usable = _usable(data, wanted)
    if usable < least:
        return Finding("excitation", Severity.INFO, "not checked: too few samples")
    reached = _persistence(data, usable)
    if reached >= wanted:
        return Finding("excitation", Severity.INFO, f"persistently exciting of order {reached} or more")
    what = f"persistently exciting of order {reached} only; order {order} needs {least} to {wanted}"
    if reached >= usable:
        return Finding("excitation", Severity.INFO, f"persistently exciting of order {reached} or more")
    refused = reached < least
    lower = p * (reached // 2) if refused else reached // 2
    return Finding(
        "excitation",
        Severity.ERROR if refused else Severity.WARNING,
        what,
        ", ".join(data.input_names),
        "excite a wider band (squares, PRBS, multisine)" + (f", or ask for order {lower}" if lower else ""),
    )


def highest_excited_order(data: IdentificationData, order: int) -> int:
    """The highest order, up to a given one, that `check_excitation` does not refuse; 0 if it refuses all.

    Parameters
    ----------
    data : IdentificationData
        Data with finite values.
    order : int
        Highest number of states of interest.

    Returns
    -------
    int
        Number of states.
    """
    p = len(data.output_names)
    usable = _usable(data, 2 * order)
    reached = _persistence(data, usable)
    return order if reached >= usable else min(order, p * (reached // 2))


def _usable(data: IdentificationData, wanted: int) -> int:
    """Order of persistent excitation up to which the samples of the longest experiment can show it."""
    return min(wanted, max(item.steps for item in data.experiments) // (2 * len(data.input_names)))


def _persistence(data: IdentificationData, most: int) -> int:
    """Order of persistent excitation of the inputs, as far as `most`."""
    if most == 0:
        return 0
    m = len(data.input_names)
    factor, _ = triangle_of(rows_of(u, range(most)) for u, _ in pieces(data, most - 1))
    reached = most
    while reached and _weakest(factor[: m * reached, : m * reached]) < _EXCITED:
        reached -= 1
    return reached


def _weakest(factor: np.ndarray) -> float:
    """Smallest singular value relative to the largest."""
    strengths = linalg.svdvals(factor, check_finite=False)
    return float(strengths[-1] / strengths[0]) if strengths[0] > 0.0 else 0.0
