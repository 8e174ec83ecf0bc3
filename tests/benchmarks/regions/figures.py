"""What `make bench-regions` writes to results/bench_regions.json."""

from __future__ import annotations

from tests.front_door.figures import Figures


class Found(Figures):
    """How many of the cases are found."""

    cases: int
    seed: int
    found: int


class ConstantLine(Figures):
    """Hum and unbalance that are no region."""

    cases: int
    seed: int
    false_b: int
    false_c: int


class ConstantLineDrift(Figures):
    """Drifts beside them."""

    cases: int
    seed: int
    found: int
    within_2_percent: int


class LightDamping(Figures):
    """Lightly damped modes that are no region."""

    cases: int
    seed: int
    false_c: int


class Planted(Figures):
    """Planted onsets."""

    cases: int
    seed: int
    planted: int
    found: int
    false: int
    error_percent: float | None
    error_percent_largest: float | None


class DesignSeeds(Figures):
    """Seeds of bearings and signals."""

    bearings: int
    designed: list[int]
    new: list[int]


class Design(Figures):
    """Excitations designed for drawn bearings."""

    runs: int
    fit_90: int
    least_fit: float
    bearings: int
    limit_broken_at_twice: int
    least_share_of_limit_at_twice: float
    limited_by: list[str]
    seeds: DesignSeeds


class TurningMap(Figures):
    """The map of a rotor that turns, beside that at rest."""

    sweeps: int
    b_percent: float
    d_percent: float
    c_at_rest: int
    c_turning: int


class DriftIdentification(Figures):
    """Identification under drift of the sensors."""

    runs: int
    right: int
    error_ratio: float
    error_ratio_median: float
    worst: str
    uncured_error_ratio_least: float
    uncured_error_ratio: float
    seeds: list[int]


class DeadTime(Figures):
    """Dead times advised."""

    runs: int
    false: int
    delayed: int
    found: int
    seeds: list[int]


class Lamination(Figures):
    """Diffusion into laminations against its closed form."""

    error_percent: float
    terms_percent: float
    running_plant_percent: float
    switching_loss_percent: float
    thin_w: float
    diffusion_w: float
    laminations: int
    plants: int
    seed: int


class Onsets(Figures):
    """Frequencies (Hz) at which regions begin, one for each amplitude; None where there is no such region."""

    b: list[float | None]
    c: list[float | None]
    d: list[float | None]


class PaperSweeps(Figures):
    """The sweep that the paper states for Fig. 5, and what changes it; amplitudes in um."""

    amplitudes: list[int]
    paper: Onsets
    limit_10_a: Onsets
    no_gravity: Onsets
    on_measurement: Onsets
    top_coil: Onsets
    top_coil_10_a: Onsets


class BenchRegions(Figures):
    """All of it."""

    constant_line: ConstantLine
    constant_line_drift: ConstantLineDrift
    slow_line: Found
    light_damping: LightDamping
    planted: Planted
    design: Design
    turning_map: TurningMap
    drift_identification: DriftIdentification
    dead_time: DeadTime
    lamination: Lamination
    paper_sweeps: PaperSweeps
