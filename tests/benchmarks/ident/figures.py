"""What `make bench-ident` writes to results/bench_ident.json."""

from __future__ import annotations

from tests.front_door.figures import Figures


class Bound(Figures):
    """What no unbiased method can beat; percent."""

    fit_squares: float
    fit_multisine: float
    frf_max_percent: float
    frf_below_500_percent: float


class Method(Bound):
    """Medians over the runs that gave a model, None where they diverge, and counts."""

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


class DataSet(Figures):
    """Our methods on one data set."""

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


class RealData(Figures):
    """Our methods on the CD player."""

    ours: RealMethod
    ours_ssarx: RealMethod
    ours_pbsid: RealMethod


class BenchIdent(Figures):
    """All that is measured without other packages; the CD player only where its file is."""

    squares: DataSet
    multisine: DataSet
    squares_noise10: DataSet
    rotor4: DataSet
    siso: DataSet
    cd_player: RealData | None = None
