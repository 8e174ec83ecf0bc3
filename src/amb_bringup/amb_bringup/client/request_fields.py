"""Fields of requests: paths that nodes in other folders can read, names of controllers, settings that are checked."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from amb_bringup.client.errors import ClientError

if TYPE_CHECKING:
    from amb_core.data.experiments import DataDescription

FILES = (".yaml", ".yml", ".json", ".npz", ".mat")  # of parameters, and of linear controllers


def absolute(path: str | Path) -> str:
    """A path as text for a node in another folder; empty for none."""
    return str(Path(path).absolute()) if path else ""


def description_text(description: DataDescription | str | Path) -> str:
    """A description of data as text for a node in another folder: its content, or an absolute path."""
    if not isinstance(description, str | Path):
        return description.with_absolute_controller().text
    return absolute(description) if str(description).lower().endswith(FILES) else str(description)


def controller_name(name: str | Path) -> str:
    """The name of a controller; the path of its file made absolute."""
    return absolute(name) if str(name).lower().endswith(FILES) else str(name)


def with_settings(request: Any, own: dict[str, Any], settings: dict[str, Any]) -> dict[str, Any]:
    """Fields of a request: those that the client fills in, and settings, which must be other fields of it."""
    known = request.get_fields_and_field_types()
    for name in settings:
        if name not in known or name in own:
            why = f"'{name}' is no setting: the client fills it in" if name in own else f"unknown setting '{name}'"
            raise ClientError(f"{why}; allowed: {', '.join(field for field in known if field not in own)}")
    return {**own, **settings}
