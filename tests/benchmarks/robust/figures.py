"""What `make bench-robust` writes to results/bench_robust.json."""

from __future__ import annotations

from typing import Annotated

from tests.benchmarks.robust.misfit_plants import HONEST, KINDS
from tests.benchmarks.robust.monte_carlo import Bearing, Rotor
from tests.benchmarks.robust.swept import BEARINGS
from tests.front_door.figures import Figures, rows_of


class Unstable(Figures):
    """Unstable loops with margins."""

    loops: int
    certified: int


class Mu(Figures):
    """Bounds of the structured singular value."""

    loops: int
    median_gap_percent: float
    worst_gap_percent: float
    replayed: int
    on_circle: int
    ordered: int
    mixed_loops: int
    median_mixed_gap_percent: float
    worst_mixed_gap_percent: float
    mixed_on_circle: int


class Peak(Figures):
    """Peaks against a fine search."""

    loops: int
    error: float


class Emulated(Figures):
    """Measured sensitivity against that of a model, on an emulated rig."""

    worst_db: float
    worst_at_hz: float
    median_db: float
    frequencies: int
    from_hz: float
    to_hz: float
    coherence: float


class Simulated(Figures):
    """The same on the nonlinear simulator."""

    worst_db: float
    worst_at_hz: float
    median_db: float
    frequencies: int
    from_hz: float
    to_hz: float
    worst_db_of_linearised_plant: float


class Swept(Figures):
    """Both, by bearing."""

    worst_db: float
    bearings: Annotated[dict[str, Simulated], rows_of(lambda: BEARINGS)]
    emulator: Emulated


class Seconds(Figures):
    """Clock and processor (s)."""

    two_by_two: float
    two_by_two_cpu: float
    four_by_four: float
    four_by_four_cpu: float


class Peer(Figures):
    """Disk margins of a package."""

    name: str
    loops: int
    wrong: int
    wrong_unstable: int
    wrong_stable: int
    no_answer_stable: int
    seconds: float
    median_of_exact: float


class Covered(Figures):
    """How often the truth lies in the bounds, on one plant."""

    runs: int
    without_model: int
    inside: int
    inside_by_axis: list[int]
    gap_inside: int
    poles_inside: int
    sampled_runs: int
    width_ratio: float
    width_ratio_worst: float
    gap_width_ratio: float
    pole_width_ratio: float
    largest_distance: float
    drift_removed: int
    not_white: int


class Coverage(Figures):
    """The same on all plants."""

    runs: int
    inside: int
    width_ratio: float
    plants: Annotated[dict[str, Covered], rows_of(lambda: (Bearing.name, Rotor.name))]


class HiddenModes(Figures):
    """Modes that nobody knows of, swept."""

    modes: int
    found_or_named: int


class Again(Figures):
    """Certificates computed again from certificate.json and their files."""

    certificates: int
    equal: int


class MisfitKind(Figures):
    """Claims about bearings of a kind, each under two controllers, and processor time of a bearing (s)."""

    plants: int
    certified: int
    predicted: int
    restricted: int
    restricted_unstable: int
    refused: int
    without_claim: int
    lies: int
    mild_certified: int
    width_median: float | None
    seconds: float | None


class Misfit(Figures):
    """Claims about bearings that a model may not fit."""

    plants: int
    certified: int
    predicted: int
    restricted: int
    restricted_unstable: int
    lies: int
    honest: int
    honest_certified: int
    width_median: float | None
    kinds: Annotated[dict[str, MisfitKind], rows_of(lambda: (HONEST, *KINDS))]


class OverRefusal(Figures):
    """Right models that are refused."""

    models: int
    refused: int
    restricted: int


class Stated(Figures):
    """What a certificate states."""

    statement: str
    verdict: str


class Demo(Figures):
    """The demo's square waves, and the experiment of the guide."""

    squares: Stated
    guide: Stated


class BenchRobust(Figures):
    """All of it."""

    unstable: Unstable
    mu: Mu
    peak: Peak
    swept: Swept
    seconds: Seconds
    peers: list[Peer]
    coverage: Coverage
    misfit: Misfit
    over_refusal: OverRefusal
    demo: Demo
    hidden_modes: HiddenModes
    again: Again
