"""Names of the numbers in files of results, with unit and meaning: the schema of version `VERSION`.

A number belongs to the innermost of these names on its way from the top of the file; names of axes, signals and regions
may stand below. Below settings, parameters and limits stand parameters with their declared names and units.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

DECLARED = ("settings", "parameters", "limits", "surface")
"""Below these stand parameters by their declared names."""

NAMES: dict[str, tuple[str, str]] = {
    "version": ("-", "version of names and units of the file"),
    "order": ("-", "number of states of the model"),
    "samples": ("-", "samples"),
    "sample_time": ("s", "sample time"),
    "steps": ("-", "samples of an experiment, a run or an excitation"),
    "first_step": ("-", "step of the first sample"),
    "first_steps": ("-", "of each experiment, step of the first sample"),
    "step": ("-", "step at which it happens"),
    "run": ("-", "number of the run"),
    "fit": ("percent", "closed-loop fit by output"),
    "fit_percent": ("percent", "fit by output; of a prediction by horizon and output"),
    "fit_without_means_percent": ("percent", "closed-loop fit by output, means left out"),
    "possible_fit_percent": ("percent", "closed-loop fit by output that the data allow"),
    "innovation_rms": ("unit of the output", "rms of the innovation by output"),
    "input_offset": ("unit of the input", "operating point by input"),
    "output_offset": ("unit of the output", "operating point by output"),
    "offset": ("unit of the output", "mean of measured less simulated output"),
    "real": ("-", "real part of a pole, z plane"),
    "imaginary": ("-", "imaginary part of a pole, z plane"),
    "deviation": ("-", "standard deviation; of a pole that of real and imaginary part"),
    "unstable_poles": ("-", "number of poles outside the unit circle, or these as [real, imaginary], z plane"),
    "poles_at_one": ("-", "poles that cannot be distinguished from 1, as [real, imaginary], z plane"),
    "closed_loop_poles": ("-", "poles of model and controller, as [real, imaginary], z plane"),
    "largest_pole": ("-", "largest magnitude of a pole of the closed loop, z plane"),
    "feedthrough": ("unit of output over input", "direct feedthrough, by output and input"),
    "iterations": ("-", "iterations of the search"),
    "left": ("-", "decrease of the criterion that the search still expected, relative"),
    "corner": ("Hz", "corner frequency of the filter against drift"),
    "experiment": ("-", "index of the experiment"),
    "size": ("unit of the output", "size by output"),
    "chosen": ("-", "order that was chosen"),
    "orders": ("-", "orders that were tried"),
    "bic": ("-", "criterion of Bayes by order"),
    "aic": ("-", "criterion of Akaike by order"),
    "validation_error": ("-", "prediction error on data held back, by order"),
    "singular_values": ("-", "singular values of the subspace estimate"),
    "overlap": ("-", "share of the samples of the identification among the data"),
    "horizons": ("-", "prediction horizons in steps"),
    "lags": ("-", "lags of the tests of residuals"),
    "mean": ("unit of the output", "mean of the residuals by output"),
    "statistic": ("-", "statistic of a test"),
    "limit": ("-", "limit of a statistic or deviation"),
    "degrees": ("-", "degrees of freedom of a test"),
    "p_value": ("-", "probability of the statistic by chance"),
    "p_estimated": ("-", "the same for a model that was estimated from as few samples as this one"),
    "unexplained": ("-", "share of the variance that a test found explained by what should not explain it"),
    "low": ("Hz", "lowest frequency of a band; of a dwell where nothing begins"),
    "high": ("Hz", "highest frequency of a band; of a dwell where it begins"),
    "lines": ("-", "number of frequencies"),
    "error": ("-", "relative error of the response"),
    "difference": ("-", "relative difference of two responses, or of amplitudes (m)"),
    "largest": ("-", "largest difference in a band"),
    "within": ("-", "share of the frequencies within the uncertainty"),
    "value": ("-", "value that the data say, in its own unit"),
    "coherence": ("-", "coherence of the position with the reference"),
    "lowest_coherence": ("-", "lowest coherence of a band"),
    "noise_and_distortion_percent": ("percent", "noise and distortion over the explained motion"),
    "distortion_percent": ("percent", "distortion over the linear response"),
    "distortion_upper_percent": ("percent", "upper 95 % confidence bound of the distortion of the class of references"),
    "distortion_db": ("dB", "the same"),
    "even_percent": ("percent", "distortion of even order"),
    "odd_percent": ("percent", "distortion of odd order"),
    "noise_percent": ("percent", "noise of a period over the linear response"),
    "time": ("s", "time"),
    "onsets": ("s", "time by region from the release of the rotor"),
    "input_frequency": ("Hz", "frequency of the excitation"),
    "shares": ("-", "share by region, of time or of power"),
    "not_judged": ("-", "shares of the updates without a test for B and C, by axis; axes without one for D; in words"),
    "share": ("-", "share of the power"),
    "gaps": ("-", "spans of steps without usable samples"),
    "frozen": ("-", "positions that stay the same while their axis moves, with the steps"),
    "sampling_beats": ("Hz and s", "input frequency and time of beats with the sample rate, from and to"),
    "amplitude": ("m", "amplitude"),
    "largest_amplitude": ("m", "largest amplitude within the limits"),
    "beyond_amplitude": ("m", "smallest amplitude tried beyond the limits"),
    "map_amplitude": ("m", "largest amplitude in region A by the map"),
    "frequency": ("Hz", "frequency"),
    "phase": ("rad", "phase"),
    "product": ("-", "orders of the tones that make a line"),
    "tones": ("Hz", "tones that the reference lacks, as of an unbalance, which were left out"),
    "folds": ("-", "how often a line is folded at the Nyquist frequency"),
    "bias": ("m", "shift of the mean position"),
    "bias_shift": ("m", "shift of the mean position by axis"),
    "line_change": ("-", "relative change of the lines from one part to the next"),
    "bias_change": ("m", "change of the bias from one part to the next"),
    "off_lines": ("m", "rms between the lines"),
    "own": ("m", "rms of what is no product of the tones"),
    "rms": ("m", "rms, or that of a slow oscillation"),
    "peak": ("m", "largest magnitude"),
    "margin": ("-", "factor of the amplitude up to the limit"),
    "map_margin": ("-", "factor of the amplitude up to region B on the map"),
    "load": ("-", "how much of the limit of a region is used"),
    "crest_factor": ("-", "peak over rms"),
    "static_current": ("A", "control current at rest"),
    "bias_current": ("A", "bias current"),
    "current_limit": ("A", "limit of the control current"),
    "slew_rate": ("A/s", "slew rate limit of the current"),
    "command_rms": ("A", "rms of the control current"),
    "command_peak": ("A", "peak of the control current with that at rest"),
    "slew_rms": ("A/s", "rms of the slew of the control current"),
    "slew_peak": ("A/s", "peak of the slew of the control current"),
    "limited": ("-", "share of the samples above the current limit"),
    "slewed": ("-", "share of the samples beyond the slew limit"),
    "clipped": ("-", "share of the samples with a clipped control current"),
    "current_margin": ("-", "factor of the amplitude up to the current limit"),
    "slew_margin": ("-", "factor of the amplitude up to the slew limit"),
    "deviation_percent": ("percent", "deviation from the linear response"),
    "seeds": ("-", "number of simulated realisations"),
    "identifiable_order": ("-", "largest order that the excitation allows"),
    "identifiable_order_tried": ("-", "largest order that was tried"),
    "boundaries": ("Hz", "frequency at which a region begins, by region"),
    "amplitudes": ("-", "number of amplitudes compared"),
    "median_ratio": ("-", "median of a ratio of frequencies"),
    "smallest_ratio": ("-", "smallest ratio of frequencies"),
    "largest_ratio": ("-", "largest ratio of frequencies"),
    "moved_more_than_10_percent": ("-", "number of boundaries that moved by more than 10 percent"),
    "only_first": ("-", "number of boundaries found by the first way only"),
    "only_second": ("-", "number of boundaries found by the second way only"),
    "inducing_amplitude": ("m", "amplitude of the inducing tone"),
    "inducing_frequency": ("Hz", "frequency of the inducing tone"),
    "state": ("-", "code of the state by amplitude and frequency"),
    "slow_amplitude": ("m", "amplitude of the slow oscillation"),
    "slow_frequency": ("Hz", "frequency of the slow oscillation"),
    "slow_rms": ("m", "rms of the slow oscillation"),
    "slow_origin": ("-", "code of the origin of the slow oscillation"),
    "rpm": ("1/min", "running speed"),
    "hz": ("Hz", "running speed"),
    "natural_hz": ("Hz", "natural frequency"),
    "damped_hz": ("Hz", "damped frequency"),
    "damping_ratio": ("-", "damping ratio"),
    "gain": ("-", "gain of a mode"),
    "shape": ("-", "deflection of a mode by axis, largest 1"),
    "orbit": ("-", "half axes of the orbit of a mode"),
    "largest_frequency_error_percent": ("percent", "largest error of a natural frequency"),
    "frequency_error_percent": ("percent", "error of a natural frequency"),
    "missing": ("Hz", "natural frequency that was computed and not identified"),
    "surplus": ("Hz", "natural frequency that was identified and not computed"),
}
"""Unit and meaning of each name."""


def unnamed(values: Any) -> list[str]:
    """Where plain values have numbers that `NAMES` does not explain.

    Parameters
    ----------
    values : object
        Plain values, as `plain` gives them.

    Returns
    -------
    list of str
        Places as dotted names, sorted.
    """
    return sorted({".".join(place) for place in _numbers(values, ()) if not any(name in NAMES for name in place)})


def _numbers(values: Any, place: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    if isinstance(values, dict):
        for name, part in values.items():
            if name not in DECLARED:
                yield from _numbers(part, (*place, name))
    elif isinstance(values, list):
        for part in values:
            yield from _numbers(part, place)
    elif isinstance(values, int | float) and not isinstance(values, bool):
        yield place
