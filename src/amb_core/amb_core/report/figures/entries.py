"""Entries of frequency responses of m inputs and p outputs: the chosen ones, and the faint cross terms among them.

A cross term is faint if it is no more than noise or rounding at most frequencies. Where a response was measured, its
coherence decides: that of the output, and the share of the entry itself in what its estimate varies,
|G|^2 / (|G|^2 + deviation^2). Models alone have none; there an entry is faint below 1 % of the largest singular value.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import IdentificationError
from amb_core.identification.frequency_response import FrequencyResponse

LOW_COHERENCE = 0.5
SMALL = 0.01
"""Of the largest singular value at the same frequency."""

Entry = tuple[str, str]
"""Names of an input and an output."""


def entries_from(text: str, inputs: Sequence[str], outputs: Sequence[str]) -> list[Entry] | None:
    """Entries of a text such as `i_x:x,i_x:y`, or `diagonal`; None, for all, of an empty one.

    Raises
    ------
    IdentificationError
        If it names others.
    """
    if not text:
        return None
    if text == "diagonal":
        return list(zip(inputs, outputs, strict=False))
    entries = []
    for part in text.split(","):
        of_input, _, output = (name.strip() for name in part.partition(":"))
        if of_input not in inputs or output not in outputs:
            raise IdentificationError(
                f"entry {part.strip()!r} is not allowed; allowed: diagonal, or input:output with inputs "
                f"{', '.join(inputs)} and outputs {', '.join(outputs)}"
            )
        entries.append((of_input, output))
    return list(dict.fromkeys(entries))


def faint_entries(responses: Sequence[FrequencyResponse]) -> tuple[NDArray[np.bool_], str]:
    """Which entries are faint cross terms, shape (p, m), and why, for a legend; empty if none is.

    Parameters
    ----------
    responses : sequence of FrequencyResponse
        Of the same signals, at positive frequencies.
    """
    measured = next((response for response in responses if response.coherence is not None), None)
    if measured is not None and measured.coherence is not None:
        coherence = np.repeat(measured.coherence[:, :, np.newaxis], len(measured.input_names), axis=2)
        if measured.magnitude_deviation is not None:
            power, noise = measured.magnitude**2, 2.0 * measured.magnitude_deviation**2
            share = power / np.maximum(power + noise, np.finfo(float).tiny)
            coherence = np.minimum(coherence, share)
        low, reason = coherence < LOW_COHERENCE, f"coherence below {LOW_COHERENCE:g}"
    else:
        largest = [np.linalg.norm(response.response, ord=2, axis=(1, 2)) for response in responses]
        small = [
            response.magnitude < SMALL * size[:, np.newaxis, np.newaxis]
            for response, size in zip(responses, largest, strict=True)
        ]
        low = np.concatenate(small)
        reason = f"below {100.0 * SMALL:g} % of the largest singular value"
    faint = np.asarray(low.mean(axis=0) > 0.5)
    if faint.shape[0] == faint.shape[1]:
        np.fill_diagonal(faint, False)
    return faint, f"faded: {reason} at most frequencies" if faint.any() else ""
