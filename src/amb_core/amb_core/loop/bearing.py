"""What plant and region classifier both take for granted about a bearing of which nothing else is known."""

BACKUP_BEARING_RADIUS = 250e-6
"""Radial displacement at which the rotor touches the backup bearing (m)."""
