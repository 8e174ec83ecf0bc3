"""Excitations from requests, in which 0 or empty means `not given`, from settings, and from definitions."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

from amb_core.excitation.deterministic import Square, Sweep, Tones
from amb_core.excitation.seeded import Multisine, Prbs, WhiteNoise
from amb_core.excitation.signal import Excitation
from amb_core.ground.errors import ExcitationError
from amb_core.ground.given_values import require_kind, require_word
from amb_core.ground.parameters import validate

KINDS: dict[str, type[Excitation]] = {kind.kind: kind for kind in (Sweep, Square, Multisine, Prbs, WhiteNoise, Tones)}
_FIELDS = {field for kind in KINDS.values() for field in kind.model_fields}


def excitation_from_request(kind: str, values: Mapping[str, Any]) -> Excitation:
    """Make the parameters of an excitation from a request.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    values : Mapping
        Values by field name, in SI units. 0, an empty text and an empty list mean `not given`: the kind's default
        applies. Fields that only other kinds use must not be given.

    Returns
    -------
    Excitation
        The excitation.

    Raises
    ------
    ExcitationError
        If the kind is unknown, a value is out of range, a field is not used by the kind, or one without default is
        missing; the message has one line.
    """
    require_kind("values", values, Mapping, "values by name of the field", ExcitationError)
    return excitation_from_settings(
        kind, {name: value for name, value in values.items() if name not in _FIELDS or _plain(value)}
    )


def excitation_from_settings(kind: str, values: Mapping[str, Any]) -> Excitation:
    """Make the parameters of an excitation from the settings that a user gave; every value counts, 0 too.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    values : Mapping
        Values by field name, in SI units; for others the kind's default applies.

    Returns
    -------
    Excitation
        The excitation.

    Raises
    ------
    ExcitationError
        As `excitation_from_request`.
    """
    parameters = _class_of(kind)
    require_kind("values", values, Mapping, "values by name of the field", ExcitationError)
    fields = parameters.model_fields
    used = ", ".join(fields)
    given = {name: _plain(value) for name, value in values.items()}
    for name, value in given.items():
        if name not in fields:
            problem = f"{kind} does not use '{name}'" if name in _FIELDS else f"unknown field '{name}'"
            raise ExcitationError(f"{problem} = {value!r}; {kind} uses {used}")
    for name, field in fields.items():
        if field.is_required() and name not in given:
            raise ExcitationError(f"{kind} has no default for '{name}'; give it ({kind} uses {used})")
    for name, value in given.items():
        if isinstance(value, tuple) and any(isinstance(item, float) and not math.isfinite(item) for item in value):
            raise ExcitationError(f"{kind}: '{name}' = {list(value)} is not allowed; every value must be finite")
    return validate(parameters, given, ExcitationError)


def definition_of(excitation: Excitation) -> str:
    """The settings of an excitation as JSON, as messages and bags carry them.

    Parameters
    ----------
    excitation : Excitation
        The excitation, of any kind.

    Returns
    -------
    str
        A JSON object by field name, in SI units.
    """
    require_kind("excitation", excitation, Excitation, "an Excitation", ExcitationError)
    return json.dumps(excitation.model_dump())


def excitation_from_definition(kind: str, definition: str) -> Excitation:
    """The excitation that `definition_of` describes.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    definition : str
        JSON object of settings by field name, in SI units. Missing settings take the kind's default.

    Returns
    -------
    Excitation
        The excitation.

    Raises
    ------
    ExcitationError
        If the kind is unknown, the text is not such an object, or a setting is unknown, missing or out of range.
    """
    parameters = _class_of(kind)
    require_kind("definition", definition, str, "a text as of definition_of", ExcitationError)
    try:
        values = json.loads(definition)
        if not isinstance(values, dict):
            raise ExcitationError(f"{kind}: its description must be a JSON object of settings, not {definition!r}")
        return validate(parameters, values, ExcitationError)
    except (ValueError, RecursionError) as problem:
        reason = "nested too deeply" if isinstance(problem, RecursionError) else problem
        raise ExcitationError(f"{kind}: its description is not a JSON object of settings: {reason}") from None


def _class_of(kind: str) -> type[Excitation]:
    require_word("kind of excitation", kind, KINDS, ExcitationError)
    return KINDS[kind]


def _plain(value: Any) -> Any:
    """A number, text or tuple from a value of any array type; it is true if the value is given."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    return tuple(value) if isinstance(value, list) else value
