"""What `make bench-ident` writes to results/bench_ident.json."""

from __future__ import annotations

from typing import Self

from pydantic import ConfigDict, model_validator

from tests.benchmarks.ident import peers
from tests.front_door.figures import Figures


class Bound(Figures):
    """What no unbiased method can beat; percent."""

    fit_squares: float
    fit_multisine: float
    frf_max_percent: float
    frf_below_500_percent: float


class Method(Bound):
    """Medians over the runs that gave a model, None where they diverge, counts, and why the first of them failed."""

    fit_squares: float | None
    fit_multisine: float | None
    frf_max_percent: float | None
    frf_below_500_percent: float | None
    seconds: float
    peak_mb: float
    innovation_ratio: float
    runs: int
    unstable_poles_right: int
    closed_loop_stable: int
    failures: int
    reason: str | None = None


class Peer(Figures):
    """The same of a method of another package: no medians where every run failed, and no innovations without a gain."""

    fit_squares: float | None = None
    fit_multisine: float | None = None
    frf_max_percent: float | None = None
    frf_below_500_percent: float | None = None
    fit_simulation: float | None = None
    fit_prediction: float | None = None
    seconds: float | None = None
    peak_mb: float | None = None
    innovation_ratio: float | None = None
    runs: int
    unstable_poles_right: int | None = None
    closed_loop_stable: int | None = None
    failures: int
    reason: str | None = None


class BesidePeers(Figures):
    """Our methods by name, and beside them those of other packages, where they are installed."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Peer]

    @model_validator(mode="after")
    def _only_peers(self) -> Self:
        for name in self.__pydantic_extra__:
            if name not in peers.NAMES:
                raise ValueError(f"{name} is no method; those of other packages: {', '.join(peers.NAMES)}")
        return self


class DataSet(BesidePeers):
    """The methods on one data set."""

    ours: Method
    ours_ssarx: Method
    ours_pbsid: Method
    bound: Bound


class RealMethod(Figures):
    """Fits of one method on data of a real plant; percent."""

    fit_simulation: float
    fit_prediction: float
    seconds: float
    peak_mb: float
    runs: int
    failures: int
    reason: str | None = None


class RealData(BesidePeers):
    """The methods on the CD player."""

    ours: RealMethod
    ours_ssarx: RealMethod
    ours_pbsid: RealMethod


class BenchIdent(Figures):
    """All data sets; the CD player only where its file is."""

    squares: DataSet
    multisine: DataSet
    squares_noise10: DataSet
    rotor4: DataSet
    siso: DataSet
    cd_player: RealData | None = None
