"""What plant and region classifier both declare about the bearing."""

from __future__ import annotations

from typing import Any

from amb_core.parameters import quantity


def backup_bearing_radius(meaning: str) -> Any:
    """Declare the radial displacement at which the rotor touches the backup bearing (m), with what it means there."""
    return quantity(250e-6, "m", meaning, 1e-6, 1e-2)
