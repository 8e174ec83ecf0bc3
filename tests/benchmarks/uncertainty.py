"""Stated errors of models beside those found: many runs of the known bearing of `tests.benchmarks.ident`.

A model is identified from each run of a data set, with another noise each time. How much the models differ is compared
with the deviations that `estimate_uncertainty` states for each, and how often its 99 % bands hold the truth is counted.
Prints a table and writes results/bench_uncertainty.json.

    python -m tests.benchmarks.uncertainty
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from amb_core.data.experiments import IdentificationData
from amb_core.identification import estimate_uncertainty, pem, ssarx
from amb_core.identification.frequency_response import FrequencyResponse, response_of
from tests.benchmarks.ident.cases import CASES
from tests.benchmarks.ident.plant import SAMPLE_TIME, STEPS
from tests.benchmarks.regions.spread import spread
from tests.front_door.figures import Figures
from tests.front_door.results import ROOT, Results

FREQUENCIES = np.geomspace(5.0, 1_000.0, 400)  # Hz
LEVEL = 0.99
RUNS = {"squares": 60, "multisine": 60, "squares_noise10": 24}

Arrays = NDArray[np.float64]


class Ratios(Figures):
    """Stated deviation over the deviation found, over all frequencies and entries of the response."""

    median: float
    percentile_5: float
    percentile_95: float


class Within(Figures):
    """Shares of true values inside their 99 % bands or regions, over frequencies, entries, poles and runs."""

    magnitude: float
    phase: float
    poles: float


class DataSet(Figures):
    """Models of the runs of one data set; `unstable_poles` are ratios as those of the response."""

    runs: int
    unstable_poles: list[float]
    magnitude: Ratios
    phase: Ratios
    within: Within


class BenchUncertainty(Figures):
    """Stated and found errors by data set."""

    squares: DataSet
    multisine: DataSet
    squares_noise10: DataSet


@dataclass(frozen=True)
class Outcome:
    """One model: its response with deviations, unstable poles with deviations, and shares of true values within."""

    response: FrequencyResponse
    unstable: NDArray[np.complex128]
    unstable_deviations: Arrays
    within: tuple[float, float, float]


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="smallest sizes, into results/quick")
    quick = parser.parse_args().quick
    console, results = Console(), Results("bench_uncertainty.json", quick)
    table = Table(
        "data", "runs", "unstable poles", "magnitude", "phase", "within 99 %", title="stated / found deviation"
    )
    for name, runs in RUNS.items():
        with console.status(f"identifying {name}"):
            found = measure(name, 2 if quick else runs, 8_000 if quick else STEPS)
        results.keep(name, {name: found.model_dump()})
        shares = found.within
        table.add_row(
            name,
            str(found.runs),
            ", ".join(f"{ratio:.2f}" for ratio in found.unstable_poles),
            _cell(found.magnitude),
            _cell(found.phase),
            f"{shares.magnitude:.1%}, {shares.phase:.1%}, poles {shares.poles:.1%}",
        )
    results.drop_others(RUNS)
    console.print(table)
    console.print(f"written to {results.file.relative_to(ROOT)}")


def measure(name: str, runs: int, steps: int = STEPS) -> DataSet:
    """Stated and found errors of the models of a data set."""
    outcomes = spread(run, [(name, seed, steps) for seed in range(runs)])
    true = response_of(CASES[name].true, FREQUENCIES)
    responses = [outcome.response for outcome in outcomes]
    phases = [np.angle(response.response / true.response) for response in responses]
    poles = np.array([outcome.unstable for outcome in outcomes])
    magnitudes = [response.magnitude for response in responses]
    shares = np.mean([outcome.within for outcome in outcomes], axis=0)
    return DataSet(
        runs=runs,
        unstable_poles=_ratio([outcome.unstable_deviations for outcome in outcomes], poles.real).tolist(),
        magnitude=_ratios([response.magnitude_deviation for response in responses], magnitudes),
        phase=_ratios([response.phase_deviation for response in responses], phases),
        within=Within(magnitude=shares[0], phase=shares[1], poles=shares[2]),
    )


def run(case: tuple[str, int, int]) -> Outcome:
    """The model of one run, and what it states."""
    name, seed, steps = case
    true = CASES[name].true
    inputs, outputs = CASES[name].data(seed, steps)
    model = pem(inputs, outputs, ssarx(inputs, outputs, SAMPLE_TIME, true.order))
    uncertainty = estimate_uncertainty(model, IdentificationData.from_arrays(inputs, outputs, SAMPLE_TIME))
    response, wanted, groups = (
        uncertainty.response(FREQUENCIES),
        response_of(true, FREQUENCIES),
        uncertainty.pole_groups(),
    )
    magnitude, phase = response.magnitude_band(LEVEL), response.phase_band(LEVEL)
    assert magnitude is not None
    assert phase is not None
    turned = response.phase + np.angle(wanted.response / response.response)  # the true phase, on the same turn
    unstable = int(np.sum(np.abs(true.poles()) > 1.0))  # the largest come first
    return Outcome(
        response,
        model.poles()[:unstable],
        uncertainty.pole_deviations()[:unstable, 0],
        (
            float(np.mean((magnitude[0] <= wanted.magnitude) & (wanted.magnitude <= magnitude[1]))),
            float(np.mean((phase[0] <= turned) & (turned <= phase[1]))),
            float(np.mean([any(group.holds(complex(pole), LEVEL) for group in groups) for pole in true.poles()])),
        ),
    )


def _cell(ratios: Ratios) -> str:
    return f"{ratios.median:.2f} ({ratios.percentile_5:.2f} to {ratios.percentile_95:.2f})"


def _ratio(stated: list[Arrays], found: Arrays) -> Arrays:
    """Root mean square of the stated deviations over the deviation of what was found."""
    return np.asarray(np.sqrt(np.mean(np.square(stated), axis=0)) / np.std(found, axis=0, ddof=1))


def _ratios(stated: list[Arrays | None], found: list[Arrays]) -> Ratios:
    known = [one for one in stated if one is not None]
    low, median, high = np.percentile(_ratio(known, np.array(found)), [5.0, 50.0, 95.0])
    return Ratios(median=median, percentile_5=low, percentile_95=high)


if __name__ == "__main__":
    main()
