"""What `make bench-verdicts` writes to results/bench_verdicts.json."""

from __future__ import annotations

from tests.front_door.figures import Figures


class TrueModels(Figures):
    """Verdicts on the truth about the data, and on models identified from other data of the same bearing."""

    models: int
    validated: int
    reserved: int
    refused: int
    identified: int
    identified_validated: int
    identified_refused: int
    failed: dict[str, int]


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


class BenchVerdicts(Figures):
    """All of it."""

    true: TrueModels
    wrong: WrongModels
    controllers: Named
    bad_data: BadData
    after_stop: Named
