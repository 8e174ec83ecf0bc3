"""The table of the modes of `config/flexible.yaml` in the page of the plant, computed by the code."""

from __future__ import annotations

import re
from pathlib import Path

from amb_bringup.commands.inputs import load_loop
from amb_core.linear.model.mode import Mode
from amb_core.plant.campbell import campbell

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "explanation" / "plant.md"
TABLE = re.compile(r"(<!-- modes: flexible -->\n).*?(<!-- end -->)", re.DOTALL)
SPEED = 100.0  # Hz
ORDINALS = ("first", "second", "third", "fourth")


def mode_table() -> str:
    """A row for each pair of modes of the flexible rotor in the loop of the paper's controller."""
    loop = load_loop(ROOT / "src" / "amb_bringup" / "config" / "flexible.yaml")
    at_rest, turning = (part.selected().modes for part in campbell(*loop, (0.0, SPEED)).closed_loop)
    heads = ["modes in the loop", "at rest (Hz)", f"at {60.0 * SPEED:.0f} rpm (Hz)", "damping ratio at rest"]
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    bending = iter(ORDINALS)
    for place in range(0, len(at_rest), 2):
        still, moving = at_rest[place : place + 2], turning[place : place + 2]
        kind = still[0].kind
        cells = [
            f"{next(bending)} bending" if kind == "bending" else f"{kind}s",
            ", ".join(f"{mode.natural_hz:.1f}" for mode in still),
            ", ".join(_named(mode, kind) for mode in moving),
            ", ".join(dict.fromkeys(f"{mode.damping_ratio:.3f}" for mode in still)),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def with_current_modes(text: str) -> str:
    """The page with its table made anew."""
    return TABLE.sub(lambda match: match[1] + mode_table() + match[2], text)


def _named(mode: Mode, kind: str) -> str:
    """Frequency of a mode of a rotor that turns, and its name where it has one of its own, else its whirl."""
    name = mode.kind if mode.kind != kind else mode.whirl
    return f"{mode.natural_hz:.1f}" + ("" if name == "planar" else f" ({name})")
