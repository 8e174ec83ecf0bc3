"""Results of the subharmonic test as plain JSON values, SI units; missing numbers become null."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.subharmonics.results import Line, SubharmonicSpectrum, SubharmonicSurface

SMALLEST = 1e-9  # m, lines below are left out


def spectrum_summary(spectrum: SubharmonicSpectrum) -> dict[str, Any]:
    """Settings, state and lines of a spectrum, largest line first."""
    slow = spectrum.slow
    lines = sorted(spectrum.lines, key=lambda line: -abs(line.amplitude))
    return {
        "settings": spectrum.settings.model_dump(),
        "state": spectrum.state,
        "reason": spectrum.reason,
        "first_step": spectrum.first_step,
        "steps": spectrum.steps,
        "sample_time": spectrum.sample_time,
        "bias": _number(spectrum.bias),
        "line_change": spectrum.line_change,
        "bias_change": spectrum.bias_change,
        "off_lines": _number(spectrum.off_lines),
        "own": _number(spectrum.own),
        "slow": None
        if slow is None
        else {
            "frequency": slow.frequency,
            "amplitude": slow.amplitude,
            "rms": slow.rms,
            "origin": slow.origin,
        },
        "lines": [_line(line) for line in lines if abs(line.amplitude) >= SMALLEST],
    }


def surface_summary(surface: SubharmonicSurface) -> dict[str, Any]:
    """A surface with all its values, amplitudes first."""
    return {
        "settings": surface.settings.model_dump(),
        "surface": surface.surface.model_dump(),
        "inducing_amplitude": surface.inducing_amplitude.tolist(),
        "inducing_frequency": surface.inducing_frequency.tolist(),
        "state": surface.state.tolist(),
        "difference": _numbers(surface.difference),
        "slow_amplitude": _numbers(surface.slow_amplitude),
        "slow_frequency": _numbers(surface.slow_frequency),
        "slow_rms": _numbers(surface.slow_rms),
        "slow_origin": surface.slow_origin.tolist(),
        "bias": _numbers(surface.bias),
    }


def _line(line: Line) -> dict[str, Any]:
    product = line.product
    return {
        "frequency": line.frequency,
        "amplitude": abs(line.amplitude),
        "phase": math.atan2(line.amplitude.imag, line.amplitude.real),
        "product": product.label,
        "order": product.order,
        "folds": product.folds,
        "coincident": [other.label for other in line.products[1:4]],
    }


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _numbers(values: NDArray[np.float64]) -> list[list[float | None]]:
    return [[_number(value) for value in row] for row in values.tolist()]
