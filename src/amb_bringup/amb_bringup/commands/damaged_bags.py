"""What commands print about a bag that was not closed, or cannot be read to its end."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console


def warn_of_damage(console: Console, bag: Path, damage: str) -> None:
    """Print what cannot be read, and the command that makes a whole bag of the rest; without damage nothing."""
    if damage:
        text = f"bag {bag} is incomplete: {damage}; amb bag recover {bag} makes a whole bag of the rest"
        console.print(text, style="yellow", highlight=False, markup=False, soft_wrap=True)
