"""What a program writes: every key is declared, with its type, in one class of figures per program.

`make quick` checks the results of the smallest size against it, and the pages of the documentation take from it what
was measured.
"""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError


class Figures(BaseModel):
    """Figures by name: all that are declared, and no others."""

    model_config = ConfigDict(extra="forbid", strict=True, ser_json_inf_nan="constants")


def problems(kind: type[BaseModel], results: Any, partial: bool = False) -> list[str]:
    """What is wrong with results, a line each.

    Parameters
    ----------
    kind : type
        The declaration.
    results : object
        What was read from the file.
    partial : bool, optional
        Whether keys may be missing, in figures that are older than the keys.
    """
    try:
        kind.model_validate(results)
    except ValidationError as problem:
        return [
            f"{'.'.join(str(part) for part in item['loc']) or 'the file'}: {item['msg']}"
            for item in problem.errors()
            if not (partial and item["type"] == "missing")
        ]
    return []
