"""What `make bench-view` writes to results/first_hour.json."""

from __future__ import annotations

from tests.front_door.figures import Figures


class Skipped(Figures):
    """Why a part was not measured here."""

    skipped: str


class View(Figures):
    """The live page."""

    latency_ms: float
    latency_median_ms: float
    frames_per_s: float
    core_share: float
    lost: int
    load_average: list[float]
    hostile_executed: int
    bit_identical: bool


class Pages(Figures):
    """Seconds until pages are drawn, None where there is no such page; pages wider than their window, of all sizes."""

    report_load_s: float | None
    report_ready_s: float | None
    paper_load_s: float | None
    paper_ready_s: float | None
    sizes: list[int]
    overflow: int


class Files(Figures):
    """Data files of others."""

    tried: int
    identified: int
    refused_with_help: int
    tracebacks: int


class New(Figures):
    """Bearings that `amb new` levitates."""

    bearings: int
    levitated: int
    explained: int
    reasons: list[str]
    worst_peak_sensitivity: float


class Wishes(Figures):
    """Wishes drawn over all that `amb new` allows; internal texts must be none."""

    drawn: int
    levitated: int
    explained: int
    internal: int
    texts: list[str]


class Tutorial(Figures):
    """What the tutorial states (lines of output, numbers in prose, pictures), and how much of it came out."""

    statements: int
    reproduced: int
    missed: list[str]
    commands: int
    seconds: float


class FirstHour(Figures):
    """All of it."""

    view: View | Skipped
    pages: Pages | Skipped
    files: Files
    new: New
    wishes: Wishes
    tutorial: Tutorial
