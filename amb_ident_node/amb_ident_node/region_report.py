"""A state of the region monitor in words, for /diagnostics."""

from __future__ import annotations

import math

from amb_core.regions import AxisState, Region, RegionState

MEANINGS = {
    Region.A: "A, steady bias",
    Region.B: "B, the bias drifts",
    Region.C: "C, slow oscillation",
    Region.D: "D, delevitated",
}


def shown(state: RegionState) -> dict[str, object]:
    """A state on /diagnostics."""
    values: dict[str, object] = {
        "step": state.step,
        "region": state.region.name,
        "since": f"{state.since.time:.3f} s",
        "input frequency at its start": f"{state.since.input_frequency:.1f} Hz",
        **{f"region {axis.name}": axis.region.name for axis in state.axes},
        **{f"region of bearing {bearing.name}": bearing.region.name for bearing in state.bearings},
        "beats with the sample rate": state.sampling_beat,
    }
    for axis in state.axes:
        values |= _evidence(axis.name, axis)
    return values


def summary(state: RegionState) -> str:
    """The region of a state; A is said only where the others were looked for."""
    said = f"region {MEANINGS[state.region]}"
    if state.region is not Region.A:
        return said
    if not state.settled:
        return f"{said}, too early for B and C"
    return f"no region found, {' and '.join(state.not_judged)} not judged" if state.not_judged else said


def _evidence(name: str, axis: AxisState) -> dict[str, object]:
    """What an axis shows besides its region."""
    values: dict[str, object] = {}
    if axis.not_judged:
        values[f"not judged now {name}"] = axis.not_judged
    if axis.drift is not None:
        values[f"drift {name} since"] = f"{axis.drift.time:.3f} s"
    if axis.oscillation is not None:
        values[f"oscillation {name} since"] = f"{axis.oscillation.time:.3f} s"
    if axis.steady_amplitude > 0.0:
        values[f"steady line {name}"] = f"{axis.steady_amplitude * 1e6:.2f} um at {axis.steady_frequency:.2f} Hz"
    if not math.isnan(axis.even_distortion):
        values[f"distortion {name}"] = f"even {axis.even_distortion:.1%}, odd {axis.odd_distortion:.1%}"
    return values
