"""The safety case: table of hazards, and the state machine of the target as its compiled code has it.

`python -m docs.generators.safety` draws docs/images/state_machine.svg anew.
"""

from __future__ import annotations

import math
from collections import defaultdict
from pathlib import Path
from types import SimpleNamespace

from amb_core.rig.link import Code, Limits, TargetState, TripReason
from tests.safety_case.hazards import BARRIERS
from tests.safety_case.states import recorded, total
from tests.soak.conformance import FAULTS

ROOT = Path(__file__).parents[2]
IMAGE = ROOT / "docs" / "images" / "state_machine.svg"
SILENT = 255
"""Code of a frame that has no reply."""

STAYING = (TripReason.HOST_SILENT.name, TripReason.EXCITATION.name)
"""Trips that do not switch off."""

CENTRES = {
    TargetState.OFF: (110, 210), TargetState.LEVITATING: (400, 60), TargetState.LEVITATED: (850, 150),
    TargetState.LANDING: (540, 255), TargetState.TRIPPED: (520, 470),
}  # fmt: skip
WIDTH, HEIGHT = 130, 46
BEND = 0.14
"""How far an arrow bends, over its length, so that the two of a pair lie apart."""


def hazard_table() -> str:
    """A row for each barrier, with its tests and its number.

    Returns
    -------
    str
        In Markdown.
    """
    lines = ["| hazard | cause | barrier | number | shown by |", "|---|---|---|---|---|"]
    for one in BARRIERS:
        tests = "; ".join(f"`{test.split('::')[1]}`" for test in one.tests)
        lines.append(f"| {one.hazard} | {one.cause} | {one.does} | {number_of(one.number)} | {tests} |")
    return "\n".join(lines) + "\n"


def number_of(text: str) -> str:
    """A number with the figures that it names.

    Parameters
    ----------
    text : str
        As in `Barrier`: `limits`, `states`, `sequences`, `kinds` and `planted` are known.

    Returns
    -------
    str
        With figures of the code.

    Raises
    ------
    KeyError
        If it names another figure.
    """
    from tests.soak.commissioning import KINDS
    from tests.unit.test_target_sequences import SEQUENCES

    counts = ("states", "transitions", "hostile", "repeated", "recovered")
    states = {name: f"{total(name):_}".replace("_", " ") for name in counts}
    limits = SimpleNamespace(**vars(Limits()))
    return text.format(
        limits=limits, states=states, sequences=2 * SEQUENCES, kinds=len(KINDS), planted=len(FAULTS)
    ).replace("inf s", "never")


def command_table() -> str:
    """What each command does in each state: the states after it, and the codes of refusals.

    Returns
    -------
    str
        In Markdown.
    """
    done: dict[tuple[str, int], set[int]] = defaultdict(set)
    refused: dict[tuple[str, int], set[int]] = defaultdict(set)
    for was, name, code, to in _commands():
        (done if code in (Code.DONE, SILENT) else refused)[_shown(name), was].add(to if code in (0, SILENT) else code)
    lines = [f"| command | {' | '.join(state.name for state in TargetState)} |", "|---" * 6 + "|"]
    for name in dict.fromkeys(_shown(name) for _, name, _, _ in _commands()):
        cells = []
        for state in TargetState:
            places = [TargetState(to).name for to in sorted(done[name, state])]
            codes = [Code(code).name for code in sorted(refused[name, state])]
            stays = places == [state.name]
            cells.append("; ".join([*(["stays" if stays else " or ".join(places)] if places else []), *codes]))
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def step_table() -> str:
    """Where a control step leads from each state, and with which trips.

    Returns
    -------
    str
        In Markdown.
    """
    lines = ["| from | to | in a control step with |", "|---|---|---|"]
    for (was, to), reasons in _steps().items():
        lines.append(f"| {was.name} | {to.name} | {', '.join(reasons)} |")
    return "\n".join(lines) + "\n"


def count_table() -> str:
    """What was tried in each part of the search.

    Returns
    -------
    str
        In Markdown.
    """
    names = ("states", "frames", "measurements", "transitions", "hostile", "repeated", "recovered", "wrong")
    lines = [f"| part | {' | '.join(names)} |", "|---" * (len(names) + 1) + "|"]
    for part in recorded():
        lines.append(f"| {part['part']} | {' | '.join(str(part[name]) for name in names)} |")
    return "\n".join(lines) + "\n"


def state_machine() -> str:
    """The states as a picture: every change that the search has found.

    Returns
    -------
    str
        As SVG.
    """
    edges: dict[tuple[TargetState, TargetState], list[str]] = defaultdict(list)
    for was, name, code, to in _commands():
        label = _shown(name)
        if was != to and code in (Code.DONE, SILENT) and label not in edges[TargetState(was), TargetState(to)]:
            edges[TargetState(was), TargetState(to)].append(label)
    for (was, to), reasons in _steps().items():
        if was != to:
            trips = [reason for reason in reasons if reason not in STAYING]
            off = to == TargetState.TRIPPED
            edges[was, to].append(f"trip ({len(trips)} reasons)" if off else ", ".join(reasons))
    shapes = [_edge(was, to, labels) for (was, to), labels in edges.items() if labels]
    for state, (x, y) in CENTRES.items():
        kind = "on" if state in (TargetState.LEVITATING, TargetState.LEVITATED, TargetState.LANDING) else "off"
        shapes.append(
            f'<rect class="{kind}" x="{x - WIDTH / 2:g}" y="{y - HEIGHT / 2:g}" width="{WIDTH}" height="{HEIGHT}"'
            ' rx="8"/>'
            f'<text x="{x}" y="{y + 5}">{state.name}</text>'
        )
    return _HEAD + "\n".join(shapes) + "\n</svg>\n"


_HEAD = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 960 520" font-family="system-ui, sans-serif" \
font-size="14" role="img" aria-label="States of the target and what leads from one to another">
<style>
.on{fill:#fdf3e7;stroke:#b4610f;stroke-width:2}.off{fill:#eef3fb;stroke:#2a5ba8;stroke-width:1.5}
text{fill:#1c2733;text-anchor:middle}.t{font-size:12px;paint-order:stroke;stroke:#fff;stroke-width:4}
path{stroke:#5a6875;stroke-width:1.5;fill:none;marker-end:url(#a)}
</style>
<defs><marker id="a" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">\
<path d="M0 0 8 4 0 8z" style="fill:#5a6875;stroke:none;marker-end:none"/></marker></defs>
<rect x="0" y="0" width="960" height="520" rx="10" fill="#ffffff"/>
"""


def _edge(was: TargetState, to: TargetState, labels: list[str]) -> str:
    """A bent arrow from the border of a state to that of another, with its labels at its middle."""
    (x0, y0), (x1, y1) = CENTRES[was], CENTRES[to]
    middle = (0.5 * (x0 + x1) - BEND * (y1 - y0), 0.5 * (y0 + y1) + BEND * (x1 - x0))
    (a, b), (c, d) = _border((x0, y0), middle), _border((x1, y1), middle)
    p, q = 0.25 * (a + c) + 0.5 * middle[0], 0.25 * (b + d) + 0.5 * middle[1]
    lines = "".join(
        f'<text class="t" x="{p:.0f}" y="{q + 4 + 14 * (number - 0.5 * (len(labels) - 1)):.0f}">{label}</text>'
        for number, label in enumerate(labels)
    )
    return f'<path d="M{a:.0f} {b:.0f}Q{middle[0]:.0f} {middle[1]:.0f} {c:.0f} {d:.0f}"/>{lines}'


def _border(centre: tuple[float, float], towards: tuple[float, float]) -> tuple[float, float]:
    """Where a line from the centre of a state leaves its rectangle."""
    x, y = towards[0] - centre[0], towards[1] - centre[1]
    share = min(0.5 * WIDTH / abs(x) if x else math.inf, 0.5 * HEIGHT / abs(y) if y else math.inf)
    return centre[0] + share * x, centre[1] + share * y


def _commands() -> list[tuple[int, str, int, int]]:
    return [(was, name, code, to) for part in recorded() for was, name, code, to in part["commands"]]


def _shown(name: str) -> str:
    """A frame as a command of the protocol; nominal, landing, gains and limits are parameters."""
    first = name.split()[0].rstrip(":")
    if first in ("nominal", "landing", "gains", "half", "no", "limits"):
        return "PARAMETERS"
    return "DELEVITATE 0" if name == "DELEVITATE 0" else first


def _steps() -> dict[tuple[TargetState, TargetState], list[str]]:
    """Trips that are new in steps from one state to another; without one, what else it is."""
    reasons_of: dict[tuple[TargetState, TargetState], set[int]] = defaultdict(set)
    for part in recorded():
        for was, reason, to in part["steps"]:
            reasons_of[TargetState(was), TargetState(to)].add(reason)
    rows = {}
    for (was, to), reasons in sorted(reasons_of.items()):
        quiet = "no new trip" if was == to else "end of the ramp"
        if to == TargetState.LANDING != was:
            quiet = TripReason.HOST_SILENT.name  # latched before, when the excitation faded
        rows[was, to] = list(dict.fromkeys(TripReason(reason).name if reason else quiet for reason in sorted(reasons)))
    return rows


if __name__ == "__main__":
    IMAGE.write_text(state_machine())
