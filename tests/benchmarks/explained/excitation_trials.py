"""Signals of the page on excitations, on a map and in trials: the work that `excitation` spreads over processes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from amb_core.designs.excitation import ExcitationCheck, Limits, Trial, TrialBench, check_excitation, design_excitation
from amb_core.designs.excitation.limits import Use
from amb_core.designs.excitation.multisine_distortion import distortion_settings
from amb_core.designs.excitation.search import largest_within
from amb_core.excitation import ExcitationSignal, excitation_from_request, generate
from amb_core.excitation.deterministic import HIGHEST_AMPLITUDE
from amb_core.excitation.phases import optimised_phases, schroeder_phases
from amb_core.ground.parameters import validate
from amb_core.ground.units import UM
from amb_core.loop.control import ControllerParameters
from amb_core.plant import Plant, PlantParameters
from amb_core.regions import Region
from amb_core.regions.distortion import simulate_distortion
from amb_core.regions.region_map import RegionMap


@dataclass(frozen=True)
class Loop:
    """A bearing with its controller.

    Attributes
    ----------
    plant, controller : PlantParameters, ControllerParameters
        The paper's by default.
    rest : float
        Time at rest before an excitation (s).
    """

    plant: PlantParameters = field(default_factory=PlantParameters)
    controller: ControllerParameters = field(default_factory=ControllerParameters)
    rest: float = 1.0

    @property
    def bench(self) -> TrialBench:
        """For trials."""
        return TrialBench(self.plant, self.controller, rest=self.rest)

    def signal(self, kind: str, amplitude: float, values: dict[str, Any]) -> ExcitationSignal:
        """The signal of an amplitude (m)."""
        request = excitation_from_request(kind, {**values, "amplitude": amplitude})
        return generate(request, self.controller.sample_rate)


SLOW = Loop(
    validate(
        PlantParameters,
        {
            "magnetic_circuit.air_gap": 0.4e-3, "magnetic_circuit.journal_outer_radius": 35.2e-3,
            "magnetic_circuit.turns_per_pole": 100, "amplifier.supply_voltage": 150.0,
            "amplifier.switching_frequency": 20e3, "amplifier.bias_current": 2.0, "rotor.mass": 3.0,
            "integration.sample_rate": 20e3,
        },
    ),
    ControllerParameters(sample_rate=20e3, proportional_gain=12_430.0, derivative_gain=11.0),
    rest=0.5,
)  # fmt: skip
"""A bearing with a slow amplifier: gap 0.4 mm, 100 turns a pole, 2 A, 150 V, 3 kg."""


@dataclass(frozen=True)
class Case:
    """A signal on a loop, with the map of its bearing where one is needed.

    Attributes
    ----------
    kind : str
        Kind of excitation.
    values : dict
        Its fields except the amplitude.
    amplitude : float
        Amplitude (m).
    loop : Loop
        The loop.
    region_map : RegionMap or None
        The map.
    tolerance : float
        Relative error of a search for the largest amplitude.
    from_schroeder : bool
        Whether the phases are those of Schroeder, optimised.
    """

    kind: str
    values: dict[str, Any]
    amplitude: float = 10e-6
    loop: Loop = field(default_factory=Loop)
    region_map: RegionMap | None = None
    tolerance: float = 0.04
    from_schroeder: bool = False

    def signal(self, amplitude: float) -> ExcitationSignal:
        """The signal of an amplitude (m)."""
        made = self.loop.signal(self.kind, amplitude, self.values)
        return _optimised(made, amplitude) if self.from_schroeder else made

    def checked(self) -> ExcitationCheck:
        """The signal on the map."""
        assert self.region_map is not None
        signal = self.signal(self.amplitude)
        return check_excitation(signal, self.region_map, self.loop.controller, self.loop.plant)


def on_map_and_in_trial(case: Case) -> dict[str, object]:
    """A signal of one amplitude: prediction and trial; no bias if the rotor falls."""
    check = case.checked()
    signal = case.signal(case.amplitude)
    trial = case.loop.bench.run(signal)
    load = max((axis.load for axis in check.axes), key=lambda one: one.linear)
    return {
        "amplitude_um": round(UM * case.amplitude, 3),
        "shares": [check.shares[region] for region in Region],
        "load": load.linear,
        "load_towards_d": max(axis.load.towards[Region.D] for axis in check.axes),
        "predicted": check.predicted.name + ("" if check.certain else ", not certain"),
        "classified": _classified(trial, signal, case.loop.rest),
        "bias_um": UM * float(trial.bias_shift[1]) if trial.measures else None,
        "region": trial.region.name,
    }


def _classified(trial: Trial, signal: ExcitationSignal, rest: float) -> str:
    """Highest region by the classifier; in a sweep every region and the frequency from which it is there."""
    if signal.frequency is None or not trial.onsets:
        return trial.classified.name
    first = round(rest / signal.sample_time)
    return ", ".join(
        f"{region.name} from {signal.frequency[max(onset.step - first, 0)]:.0f} Hz"
        for region, onset in sorted(trial.onsets.items())
    )


def largest_in_a(case: Case) -> dict[str, object]:
    """The largest amplitude in A by the map, by trials and by the classifier alone."""
    by_map = case.amplitude * case.checked().map_margin
    search = Search(case)
    within, beyond = search.largest(lambda trial: trial.region, by_map)
    classified = within
    if search.tried(beyond).classified == Region.A:
        classified, _ = search.largest(lambda trial: trial.classified, beyond)
    return {
        "map_um": UM * by_map,
        "trial_um": UM * within,
        "ratio": by_map / within,
        "first_region": search.tried(beyond).region.name,
        "classifier_um": UM * classified,
    }


def crest_factor(case: Case) -> dict[str, object]:
    """Crest factor of a signal on y, and peak and rms of the largest one in A by trials."""
    within, _ = Search(case).largest(lambda trial: trial.region, case.amplitude)
    y = case.signal(within).samples[:, 1]
    rms = float(np.sqrt(np.mean(y**2)))
    return {"crest_factor": float(np.max(np.abs(y))) / rms, "peak_um": UM * within, "rms_um": UM * rms}


@dataclass(frozen=True)
class Tried:
    """Region of a trial, and the one by the classifier alone."""

    region: Region
    classified: Region


class Search:
    """Trials of a signal, each amplitude once.

    Parameters
    ----------
    case : Case
        The signal.
    """

    def __init__(self, case: Case) -> None:
        self._case, self._bench = case, case.loop.bench
        self._tried: dict[float, Tried] = {}

    def tried(self, amplitude: float) -> Tried:
        """The trial of an amplitude (m)."""
        if amplitude not in self._tried:
            trial = self._bench.run(self._case.signal(amplitude))
            self._tried[amplitude] = Tried(trial.region, trial.classified)
        return self._tried[amplitude]

    def largest(self, region_of: Callable[[Tried], Region], start: float) -> tuple[float, float]:
        """Largest amplitude in A and smallest one beyond it (m)."""

        def use_of(amplitude: float) -> Use:
            region = region_of(self.tried(amplitude))
            return Use(np.inf if region > Region.A else 0.0, region.name)

        within, beyond, _ = largest_within(use_of, start, HIGHEST_AMPLITUDE, self._case.tolerance)
        return within, beyond


def _optimised(signal: ExcitationSignal, amplitude: float) -> ExcitationSignal:
    """A multisine of the same lines with phases optimised from Schroeder's, backwards on y as there."""
    samples = np.empty_like(signal.samples)
    for axis, column in enumerate(signal.samples.T):
        spectrum = np.fft.rfft(column)
        lines = np.flatnonzero(np.abs(spectrum) > 1e-6 * np.abs(spectrum).max())
        phases = optimised_phases(lines, schroeder_phases(lines))
        spectrum[:] = 0.0
        spectrum[lines] = np.exp(1j * (-phases if axis else phases))
        period = np.fft.irfft(spectrum, len(column))
        period = np.roll(period, -np.argmin(np.abs(period)))
        samples[:, axis] = amplitude / np.max(np.abs(period)) * period
    return replace(signal, samples=samples)


def designed(case: Case) -> dict[str, object]:
    """A design, without a map."""
    loop = case.loop
    design = design_excitation(case.kind, case.values, None, loop.controller, loop.plant, tolerance=case.tolerance)
    worst, distortion = design.certificate.worst, design.distortion
    return {
        "amplitude_um": UM * design.amplitude,
        "deviation": max(one.deviation for one in worst),
        "distortion": None if distortion is None else float(distortion.ratio.max()),
        "distortion_at_most": None if distortion is None else float(distortion.upper_ratio.max()),
        "fit": min(one.fit for one in worst) / 100.0,
        "limited_by": design.limited_by.partition(":")[0],
        "trials": len(design.tried),
    }


def fit_of_new_seeds(case: Case, seeds: int) -> float:
    """Lowest fit (-) of the linearised loop on any axis with seeds that a design does not use."""
    bench, first = case.loop.bench, Limits().seeds
    fits = []
    for seed in range(first, first + seeds):
        signal = case.loop.signal(case.kind, case.amplitude, {**case.values, "seed": seed})
        fits += [measure.fit for measure in bench.run(signal).measures]
    return min(fits) / 100.0


def beyond_the_voltage(case: Case) -> dict[str, object]:
    """What a signal asks of the amplifiers, and how far the response is from linear; the worse axis of each figure."""
    loop, signal = case.loop, case.signal(case.amplitude)
    trial = loop.bench.run(signal)
    distortion = simulate_distortion(loop.plant, loop.controller, distortion_settings(signal, Limits().seeds))
    return {
        "amplitude_um": round(UM * case.amplitude, 3),
        "region": trial.region.name,
        "slewed": max(one.slewed for one in trial.measures),
        "duty_at_limit": _duty_at_limit(loop.plant, trial, signal.steps),
        "deviation": max(one.deviation for one in trial.measures),
        "distortion": float(distortion.ratio.max()),
        "fit": min(one.fit for one in trial.measures) / 100.0,
    }


def _duty_at_limit(parameters: PlantParameters, trial: Trial, steps: int) -> float:
    """Share of the samples, those of the excitation, in which the mean voltage of a coil is at its limit.

    The currents of the trial are played to the plant once more, as a trial keeps no voltages.
    """
    plant, amplifier = Plant(parameters), parameters.amplifier
    limit = amplifier.supply_voltage * (2.0 * amplifier.maximum_duty - 1.0)
    voltage = np.array([plant.trace(current).voltage.mean(axis=0) for current in trial.record.current])
    at_limit = np.abs(voltage[-steps:]) > (1.0 - 1e-3) * limit
    return float(at_limit.mean(axis=0).max())
