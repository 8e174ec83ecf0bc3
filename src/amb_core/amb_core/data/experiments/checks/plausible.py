"""Whether signals can be what they are said to be: inputs, outputs and units exchanged, and coarse values."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from amb_core.data.experiments.checks.report import Finding, Severity
from amb_core.data.experiments.conditioning import restore
from amb_core.data.experiments.dataset import IdentificationData
from amb_core.ground.units import UM

_LARGEST_POSITION = 0.1  # m; no bearing has such a clearance
_SMALLEST_MOTION = 1e-10  # m; below it no sensor of a bearing resolves
_LARGEST_CURRENT = 1_000.0  # A
_OF_CURRENTS = 0.01  # what positions in m do not reach, and currents in A do
_OF_POSITIONS = 1e-3  # what currents in A reach, and positions in m do not
_FINEST = 40  # steps of a quantised signal within four standard deviations, from which rounding is 3 % of it
_FEW_VALUES = 16  # of an input of discrete levels, such as a PRBS in open loop
_WHOLE = 0.02  # of a step: how far the distance of two values may be from whole steps


def check_roles(data: IdentificationData) -> Finding:
    """Whether currents (A) and positions (m) have the size that these have in a bearing."""
    axes = len(data.output_names)
    if data.input_units == ("m",) * len(data.input_names) and data.output_units == ("A",) * axes:
        return _exchanged("the inputs are in m and the outputs in A", data)
    if data.input_units != ("A",) * axes or data.output_units != ("m",) * axes:
        return Finding("roles", Severity.INFO, "not checked: the data are not currents in A and positions in m")
    restored = restore(data)
    currents, positions = _joined(restored, "inputs"), _joined(restored, "outputs")
    current, position = (np.quantile(np.abs(signal), 0.99, axis=0) for signal in (currents, positions))
    if current.max() < _OF_POSITIONS and position.min() > _OF_CURRENTS:
        return _exchanged(f"the currents reach {current.max():.2g} A and the positions {position.max():.2g} m", data)
    moved = np.ptp(positions, axis=0)
    wrong = (position > _LARGEST_POSITION) | (0.0 < moved.max() < _SMALLEST_MOTION)
    if wrong.any():
        names = [name for name, is_wrong in zip(data.output_names, wrong, strict=True) if is_wrong]
        return Finding(
            "roles", Severity.WARNING,
            f"positions of up to {position[wrong].max():.2g} m that move by {moved[wrong].max():.2g} m are none of a "
            "bearing: their unit is wrong", ", ".join(names), "give their unit (--units um, mm ...)",
        )  # fmt: skip
    if current.max() > _LARGEST_CURRENT:
        names = [name for name, size in zip(data.input_names, current, strict=True) if size > _LARGEST_CURRENT]
        return Finding(
            "roles", Severity.WARNING, f"currents of up to {current.max():.2g} A: their unit is wrong",
            ", ".join(names), "give their unit (--units mA)",
        )  # fmt: skip
    return Finding("roles", Severity.INFO, "currents and positions have the size of those of a bearing")


def _exchanged(what: str, data: IdentificationData) -> Finding:
    names = ", ".join((*data.input_names, *data.output_names))
    return Finding(
        "roles", Severity.WARNING, f"{what}: inputs and outputs are exchanged", names,
        "name the currents as inputs and the positions as outputs (--inputs, --outputs)",
    )  # fmt: skip


def _joined(data: IdentificationData, kind: str) -> NDArray[np.float64]:
    return np.concatenate([getattr(item, kind) for item in data.experiments])


def check_quantisation(data: IdentificationData) -> Finding:
    """Signals whose values are whole steps apart, with steps that are coarse for their motion."""
    coarse = []
    open_loop = any(item.reference is None for item in data.experiments)
    for kind in ("input", "output"):
        signals = _joined(data, f"{kind}s")
        for column, name in enumerate(getattr(data, f"{kind}_names")):
            unit = getattr(data, f"{kind}_units")[column]
            fewest = _FEW_VALUES if kind == "input" and open_loop else 3
            if is_coarse(signals[:, column], fewest):
                step = _step_of(signals[:, column], fewest)
                coarse.append((name, f"{step * UM:.3g} um" if unit == "m" else f"{step:.3g} {unit}".strip()))
    if not coarse:
        return Finding("quantised", Severity.INFO, "no signal is coarse")
    return Finding(
        "quantised", Severity.WARNING, f"values in steps of {', '.join(step for _, step in coarse)}",
        ", ".join(name for name, _ in coarse),
        "excite more, or use a finer range of this sensor or recorder: rounding is noise that no filter removes",
    )  # fmt: skip


def is_coarse(signal: NDArray[np.float64], fewest: int = 3) -> bool:
    """Whether a signal has steps that are coarse for its motion."""
    low, high = np.quantile(signal, [0.16, 0.84])
    return _step_of(signal, fewest) > 2.0 * float(high - low) / _FINEST


def _step_of(signal: NDArray[np.float64], fewest: int) -> float:
    """Distance of neighbouring values of a quantised signal; 0 for any other, and for one of fewer values."""
    values = np.unique(signal)
    if len(values) < fewest:
        return 0.0
    distances = np.diff(values)
    rounding = 1e-9 * float(np.abs(values).max())
    distances = distances[distances > rounding]
    if not len(distances):
        return 0.0
    step = float(distances.min())
    step = float(np.mean(distances[distances < 1.5 * step]))
    off = np.abs(distances / step - np.round(distances / step))
    return step if np.quantile(off, 0.9) <= _WHOLE else 0.0
