"""What `make soak` writes to results/soak.json."""

from __future__ import annotations

from tests.front_door.figures import Figures


class Pace(Figures):
    """Lateness of an emulator in real time, missed deadlines, and those caused on purpose that count."""

    p50_us: float
    p99_us: float
    p9999_us: float
    max_us: float
    missed: int
    injected: int
    counted: int
    steps_missed: int


class Recorded(Figures):
    """A rig recorded for a long time."""

    seconds: float
    axes: int
    samples: int
    lost: int
    doubled: int
    out_of_order: int
    lost_on_link: int
    bridge_cores: float
    host_cores: float
    cores_by_node: dict[str, float]
    memory_growth_percent: float
    trips: list[str]


class Link(Figures):
    """A bad network."""

    injected_gaps: int
    reported_gaps: int
    late: int
    doubled: int
    upload_s: float
    upload_exact: bool
    samples_compared: int
    start_step_error: int


class Same(Figures):
    """An experiment through bridge and emulator, and without."""

    bit_identical: bool
    frf_error_percent: float


class Lifecycle(Figures):
    """Transitions that are not allowed."""

    wrong: int
    refused: int
    alive: bool


class Trips(Figures):
    """Trips of every kind: those whose second before is whole, and those whose text names what of it is missing."""

    tried: int
    right: int
    whole: int
    lack_named: int
    kinds: dict[str, int]


class Kills(Figures):
    """Nodes killed under excitation."""

    rounds: int
    recovered: int
    jumps: int
    steepest_um_per_step: float
    median_s: float
    longest_s: float


class Fuzz(Figures):
    """Hostile frames to bridge and target."""

    bridge_frames: int
    bridge_exceptions: int
    bridge_memory_growth_percent: float
    bridge_frames_refused: int
    target_frames: int
    target_findings: int


class Forged(Figures):
    """Forged commands."""

    tried: int
    accepted: int


class Safety(Figures):
    """Random sequences of commands, faults and times against the C target."""

    sequences: int
    jumps: int
    limits_broken: int


class Recovery(Figures):
    """Hosts under attack, who lost the counter, or whose target started anew."""

    attacks: int
    recovered: int
    longest_s: float


class Commissioning(Figures):
    """Rigs with planted faults and healthy ones: named rightly, not noticed, accused; and those that touched hard."""

    rigs: int
    right: int
    silent: int
    accused: int
    touches: int


class Conformance(Figures):
    """Planted faults in ports of the target, and those that the checks name."""

    faults: int
    named: int


class BoardModel(Figures):
    """A model identified from the telemetry of the board: samples, those equal to the host's build's, worst fit."""

    samples: int
    samples_equal: int
    models_equal: bool
    fit_percent: float


class Board(Figures):
    """A Cortex-M7 in QEMU beside the host's build: frames and steps compared and equal, worst steps, stack used."""

    frames: int
    equal: int
    instructions_worst: int
    instructions_state_space: int
    stack_bytes: int
    identified: BoardModel


class Soak(Figures):
    """All of it."""

    pace: Pace
    soak: Recorded
    link: Link
    same: Same
    lifecycle: Lifecycle
    trips: Trips
    kills: Kills
    fuzz: Fuzz
    forged: Forged
    safety: Safety
    recovery: Recovery
    commissioning: Commissioning
    conformance: Conformance
    board: Board | None = None  # where compiler and QEMU are there
