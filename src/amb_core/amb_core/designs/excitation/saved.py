"""The excitation of a saved design: `amb excitation design` writes it, experiments take it from there."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from amb_core.excitation import Excitation, excitation_from_definition
from amb_core.ground.errors import ExcitationError
from amb_core.ground.files.regular_files import MIB, read_text, shown
from amb_core.ground.units import UM

SUMMARY = "summary.json"
LARGEST = 16 * MIB  # of a summary; that of a design takes about 10 KiB


def designed_excitation(folder: str | Path, changes: Mapping[str, Any] | None = None) -> Excitation:
    """The excitation that a design has found, with changes such as another seed.

    Parameters
    ----------
    folder : str or Path
        Where the design's summary.json is.
    changes : mapping, optional
        Settings instead of the design's, by field name (SI units). None for no changes.

    Returns
    -------
    Excitation
        The excitation.

    Raises
    ------
    ExcitationError
        If there is no design, a setting is wrong, or the amplitude is above that of the design, which is the largest
        that its simulations allow.
    """
    where = f"design {shown(folder)}"
    try:
        content = json.loads(read_text(Path(folder) / SUMMARY, LARGEST))
        kind, designed = str(content["kind"]), dict(content["parameters"])
    except OSError as problem:
        raise ExcitationError(
            f"{where}: {SUMMARY} cannot be read: {problem.strerror}; `amb excitation design` writes one"
        ) from None
    except (ValueError, KeyError, TypeError, RecursionError) as problem:
        raise ExcitationError(
            f"{where}: {SUMMARY} is not that of a design, as `amb excitation design` writes it ({problem!r})"
        ) from None
    largest = designed.get("amplitude")
    excitation = excitation_from_definition(kind, json.dumps(designed | dict(changes or {})))
    amplitude = getattr(excitation, "amplitude", None)
    if isinstance(largest, float) and amplitude is not None and amplitude > largest:
        raise ExcitationError(
            f"{where}: an amplitude of {UM * amplitude:g} um is not allowed; the largest within its limits is that "
            f"of the design, {UM * largest:g} um"
        )
    return excitation
