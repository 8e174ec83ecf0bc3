"""What `make bench` writes to results/bench.json."""

from __future__ import annotations

from tests.front_door.figures import Figures


class Skipped(Figures):
    """Why a benchmark was not measured here."""

    skipped: str


class Simulator(Figures):
    """The plant alone; ratios are times of ours over theirs, or theirs over ours for scipy."""

    ns_per_step: float
    realtime_factor: float
    ns_per_step_iron: float
    ns_per_step_diffusion: float
    ns_per_step_solid_journal: float
    ns_per_step_rigid: float
    c_ns_per_step: float
    c_ratio: float
    c_fused_ns_per_step: float
    c_fused_ratio: float
    solve_ivp_ratio: float
    solve_ivp_compiled_ratio: float
    solve_ivp_tolerance: float
    solve_ivp_error: float
    averaged_kernel_step: float
    averaged_kernel_error: float
    import_s: float
    first_call_s: float


class Lockstep(Figures):
    """A step in two processes."""

    ratio: float
    step_us: float
    plant_us: float
    floor_us: float


class Composed(Figures):
    """A step in one process."""

    step_us: float
    realtime_factor: float
    bit_identical: bool


class Map(Figures):
    """A region map."""

    seconds: float
    efficiency: float


class Monitor(Figures):
    """The region monitor in real time."""

    core_share: float
    lag_ms: float
    longest_lag_ms: float


class PeerRoss(Figures):
    """A sample of the same rotor in ROSS and here."""

    ratio: float
    ross_us: float
    ours_us: float


class Machine(Figures):
    """Where it was measured."""

    processor: str
    cores: int
    python: str


class Bench(Figures):
    """All of it."""

    simulator: Simulator
    lockstep: Lockstep
    composed: Composed
    composed4: Composed
    lockstep4: Lockstep
    map: Map
    monitor: Monitor
    peer_ross: PeerRoss | Skipped
    machine: Machine
