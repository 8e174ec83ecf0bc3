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


def known_settings(request: Any, settings: dict[str, Any]) -> dict[str, Any]:
    """Settings of a request, after a check that it has fields of these names."""
    known = request.get_fields_and_field_types()
    for name in settings:
        if name not in known:
            raise ClientError(f"unknown setting '{name}'; allowed: {', '.join(known)}")
    return settings
