"""Fig. 11 and 12: white noise and rectangular pulses on the frequency-amplitude graph and in simulation."""

from __future__ import annotations

from collections.abc import Mapping

from amb_core.designs.excitation import ExcitationCheck, Trial, TrialBench, check_excitation
from amb_core.excitation import Square, WhiteNoise, generate
from amb_core.ground.units import UM
from amb_core.loop.control import ControllerParameters
from amb_core.plant import PlantParameters
from amb_core.regions import Region
from amb_core.regions.region_map import RegionMap
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.overlay import overlay_chart
from amb_core.report.figures.trial import trial_chart
from amb_core.report.pages import Answer
from amb_paper.studies.frequency_amplitude_graph import paper_map
from amb_paper.study import LINEAR_IRON, Claim, DrawnFigure, Setting, Study, StudyResult, Workplace

RATE = ControllerParameters().sample_rate
NOISE = WhiteNoise(amplitude=5e-6, frequency_start=10.0, frequency_end=5_000.0, duration=3.0, axes="y")
WEAK_NOISE = NOISE.model_copy(update={"amplitude": 1e-6})
PULSES = Square(amplitude=50e-6, frequency=5.0, duration=4.0, axes="in_turn")
LARGE_PULSES = PULSES.model_copy(update={"amplitude": 90e-6})
SIGNIFICANT = 0.05  # share of the power above which a region contains a significant part of a signal


class ExcitationsOnTheMap(Study):
    """Two excitations, their regions according to the map, and those in simulation."""

    name = "fig11-12"
    heading = "Fig. 11 and 12: excitations on the graph"
    against = LINEAR_IRON
    parallel = False  # the map may have to be built

    def run(self) -> StudyResult:
        """As `run_at`, on this machine."""
        return self.run_at(Workplace())

    def run_at(self, workplace: Workplace) -> StudyResult:
        """Check both on the map, simulate both, and each again with another amplitude."""
        region_map = paper_map(workplace)
        bench = TrialBench(PlantParameters(), ControllerParameters())
        signals = {kind: generate(kind, RATE) for kind in (NOISE, WEAK_NOISE, PULSES, LARGE_PULSES)}
        checks = {kind: check_excitation(signals[kind], region_map) for kind in (NOISE, PULSES)}
        trials = {kind: bench.run(signal) for kind, signal in signals.items()}
        noise_map = overlay_chart(checks[NOISE], region_map, f"White noise of {_amplitude(NOISE)} rms on the graph")
        pulse_map = overlay_chart(
            checks[PULSES], region_map, f"Rectangular pulses of {_amplitude(PULSES)} on the graph"
        )
        return self.result(
            [
                DrawnFigure.of("fig11", noise_map),
                DrawnFigure.of("fig12", pulse_map),
                DrawnFigure.of("fig11-12-tried", _tried(trials)),
            ],
            [
                judge_noise_content(checks[NOISE]),
                judge_noise(checks[NOISE], trials[NOISE], trials[WEAK_NOISE]),
                judge_pulse_content(checks[PULSES]),
                judge_pulses(checks[PULSES], trials[PULSES], trials[LARGE_PULSES]),
            ],
            {
                "white noise": Setting(f"{_amplitude(NOISE)} rms on y, flat from 10 Hz to 5 kHz, {NOISE.duration:g} s"),
                "amplitude of the pulses": Setting(_amplitude(PULSES), "assumed, as stated for Fig. 13"),
                "pulses": Setting(f"{PULSES.frequency:g} Hz, on x and then on y, {PULSES.duration:g} s"),
            },
            [
                "A point on the graph is a sine of the same power: for white noise, each third of an octave; for the "
                "pulses, each harmonic. The effect of a signal follows from all of its points together, since the "
                "squares of their control currents add up. " + _continued(checks[NOISE], region_map)
            ],
        )


def _tried(trials: Mapping[WhiteNoise | Square, Trial]) -> Chart:
    return trial_chart(
        {
            f"white noise, {_amplitude(NOISE)} rms": trials[NOISE],
            f"white noise, {_amplitude(WEAK_NOISE)} rms": trials[WEAK_NOISE],
            f"pulses on x, then y, {_amplitude(PULSES)}": trials[PULSES],
            f"pulses on x, then y, {_amplitude(LARGE_PULSES)}": trials[LARGE_PULSES],
        },
        title="Effect of the excitations",
    )


def judge_noise_content(check: ExcitationCheck) -> Claim:
    """Whether white noise extends into B and C."""
    above = {region: check.shares[region] for region in list(Region)[1:]}
    significant = sum(above.values()) >= SIGNIFICANT
    both = above[Region.B] >= SIGNIFICANT and above[Region.C] >= SIGNIFICANT
    verdict: Answer = "agrees" if both else "agrees in part" if significant else "does not agree"
    return Claim(
        id="noise-content",
        paper_figure="Fig. 11",
        statement="On the graph, white noise shows a flat spectrum that has significant parts in regions B and C.",
        finding=f"Of its power, {_shares(check)}.",
        verdict=verdict,
        reason="" if both else "This bearing has hardly any region C: it delevitates where the paper's oscillates.",
        figure="fig11",
    )


def judge_noise(check: ExcitationCheck, trial: Trial, weak: Trial) -> Claim:
    """Whether it makes the bearing nonlinear, and a fraction of it does not."""
    induced = trial.region > Region.A
    return Claim(
        id="noise-is-nonlinear",
        paper_figure="Fig. 11",
        statement="White noise induces nonlinear behaviour, as the graph predicts.",
        finding=f"The graph predicts {check.predicted.name}: {check.verdict}. In simulation the bearing "
        f"{_outcome(trial)}; with {_amplitude(WEAK_NOISE)} rms it {_outcome(weak)}.",
        verdict="agrees"
        if induced and check.predicted > Region.A
        else "agrees in part"
        if induced
        else "does not agree",
        reason=_unforeseen(induced, check.predicted > Region.A)
        or ("" if weak.region is Region.A else "Noise of a fifth of the amplitude does so too."),
        figure="fig11-12-tried",
    )


def judge_pulse_content(check: ExcitationCheck) -> Claim:
    """Whether the pulses lie in region A."""
    linear = check.shares[Region.A]
    return Claim(
        id="pulses-content",
        paper_figure="Fig. 12",
        statement="The spectrum of rectangular pulses falls so rapidly with frequency that they lie in region A.",
        finding=f"Of their power, {_shares(check)}; the fundamental alone has {100 * _largest_share(check):.0f} %.",
        verdict="agrees" if linear > 1.0 - 1e-3 else "agrees in part" if linear > 0.9 else "does not agree",
        reason="" if linear > 1.0 - 1e-3 else "Some of their harmonics lie beyond region A.",
        figure="fig12",
    )


def judge_pulses(check: ExcitationCheck, trial: Trial, large: Trial) -> Claim:
    """Whether the bearing stays linear under them, and does not under larger ones."""
    linear = trial.region is Region.A
    return Claim(
        id="pulses-stay-linear",
        paper_figure="Fig. 12",
        statement="With a prudent amplitude, rectangular pulses leave the bearing in its linear region.",
        finding=f"The graph predicts {check.predicted.name}: {check.verdict}. In simulation the bearing "
        f"{_outcome(trial)}; with {_amplitude(LARGE_PULSES)} it {_outcome(large)}.",
        verdict="agrees"
        if linear and check.predicted is Region.A
        else "agrees in part"
        if linear
        else "does not agree",
        reason=_unforeseen(linear, check.predicted is Region.A)
        or ("" if large.region > Region.A else "Larger pulses leave it there too, so the amplitude is not critical."),
        figure="fig11-12-tried",
    )


def _unforeseen(happened: bool, predicted: bool) -> str:
    """Why a claim on the effect of an excitation, and on its prediction from the graph, does not hold."""
    if not happened:
        return "In simulation it does not."
    return "" if predicted else "In simulation it does, but the graph does not predict it."


def _amplitude(excitation: WhiteNoise | Square) -> str:
    return f"{UM * excitation.amplitude:g} µm"


def _continued(check: ExcitationCheck, region_map: RegionMap) -> str:
    """The frequency above which points lie beyond region A although the graph does not cover them."""
    axis = check.axes[-1]
    beyond = axis.frequency[(axis.region > Region.A) & (axis.amplitude < region_map.amplitudes[0])]
    if not len(beyond):
        return ""
    return (
        f"Below the smallest amplitude of the graph its boundaries are extrapolated at constant control current: "
        f"hollow points of the noise, {beyond.min():.0f} Hz and above, lie beyond region A."
    )


def _shares(check: ExcitationCheck) -> str:
    return ", ".join(f"{100 * share:.1f} % in {region.name}" for region, share in check.shares.items())


def _largest_share(check: ExcitationCheck) -> float:
    return max(float(axis.share.max()) for axis in check.axes)


def _outcome(trial: Trial) -> str:
    """Result of a trial, as the end of a sentence."""
    if trial.region is Region.D:
        return f"delevitates {trial.onsets[Region.D].time:.2f} s after its release"
    shift = UM * trial.bias_shift[1]
    return f"runs in region {trial.region.name}, its bias on y moved by {shift:.1f} µm"
