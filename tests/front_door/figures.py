"""What a program writes: every key is declared, with its type, in one class of figures per program.

`make quick` checks the results of the smallest size against it, and the pages of the documentation take from it what
was measured.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Annotated, Any, TypeVar, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationError, ValidationInfo, field_validator

T = TypeVar("T")
MayBeEmpty = Annotated[T, "may be empty"]
"""Of a table or list of records: that it may be empty, as one of findings. Any other that is empty is a fault."""
OF_A_FILE = "of a file"
"""Context in which figures are whole; while a program runs, tables may have to fill."""


class Figures(BaseModel):
    """Figures by name: all that are declared, and no others; in a file of results no table has lost its rows."""

    model_config = ConfigDict(extra="forbid", strict=True, ser_json_inf_nan="constants")

    @field_validator("*")
    @classmethod
    def _is_not_empty(cls, value: Any, info: ValidationInfo) -> Any:
        field = cls.model_fields[info.field_name or ""]
        records = any(isinstance(item, type) and issubclass(item, BaseModel) for item in get_args(field.annotation))
        has_rows = isinstance(value, dict) or (isinstance(value, list) and records)
        if info.context == OF_A_FILE and has_rows and not value and "may be empty" not in field.metadata:
            raise ValueError("is empty")
        return value


def rows_of(names: Callable[[], Iterable[str]]) -> AfterValidator:
    """That a table has the rows of these names, as in `Annotated[dict[str, float], rows_of(lambda: BEARINGS)]`."""

    def has_them(table: dict[str, Any]) -> dict[str, Any]:
        lacking = [name for name in names() if name not in table]
        more = sorted(set(table) - set(names()))
        if lacking or more:
            parts = [f"{verb} {', '.join(rows)}" for verb, rows in (("lacks", lacking), ("has also", more)) if rows]
            raise ValueError(" and ".join(parts))
        return table

    return AfterValidator(has_them)


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
        kind.model_validate(results, context=OF_A_FILE)
    except ValidationError as problem:
        return [
            f"{'.'.join(str(part) for part in item['loc']) or 'the file'}: {item['msg']}"
            for item in problem.errors()
            if not (partial and item["type"] == "missing")
        ]
    return []
