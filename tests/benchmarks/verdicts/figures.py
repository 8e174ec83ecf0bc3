"""What `make bench-verdicts` writes to results/bench_verdicts.json."""

from __future__ import annotations

from tests.front_door.figures import Figures, MayBeEmpty


class TrueModels(Figures):
    """Verdicts on the truth about the data, and on models identified from other data of the same bearing."""

    models: int
    validated: int
    reserved: int
    refused: int
    identified: int
    identified_validated: int
    identified_refused: int
    failed: MayBeEmpty[dict[str, int]]


class WrongModels(Figures):
    """Verdicts on wrong models that a likelihood-ratio test tells from the truth, by fault."""

    models: int
    tellable: int
    refused: int
    reserved: int
    validated: int
    refused_by_kind: dict[str, int]
    tellable_by_kind: dict[str, int]


class Named(Figures):
    """Cases of a fault, and those in which it is named."""

    cases: int
    named: int


class BadData(Named):
    """Records with a fault, and clean ones of which something is said."""

    clean: int
    accused: int


class Coverage(Figures):
    """Share of the points of the response inside their 95 % bands, by kind of noise; None where no band is given."""

    white: float | None
    process_noise: float | None
    forces_slow: float | None
    forces_humming: float | None
    sensors_slow: float | None
    drift_0_3: float | None
    drift_1: float | None
    drift_3: float | None
    drift_10: float | None


class DesignedDistortion(Figures):
    """Bearings with a designed excitation, and those whose certificate is false."""

    bearings: int
    false: int


class BenchVerdicts(Figures):
    """All of it."""

    true: TrueModels
    wrong: WrongModels
    controllers: Named
    bad_data: BadData
    after_stop: Named
    coverage: Coverage
    distortion: DesignedDistortion
