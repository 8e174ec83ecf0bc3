"""Results of the subharmonic test as plain JSON values, SI units; missing numbers become null."""

from __future__ import annotations

import math
from typing import Any

from amb_core.ground.results import plain
from amb_core.regions.subharmonics.results import Line, SubharmonicSpectrum, SubharmonicSurface

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
        "bias": plain(spectrum.bias),
        "line_change": spectrum.line_change,
        "bias_change": spectrum.bias_change,
        "off_lines": plain(spectrum.off_lines),
        "own": plain(spectrum.own),
        "slow": None
        if slow is None
        else {name: getattr(slow, name) for name in ("frequency", "amplitude", "rms", "origin")},
        "lines": [_line(line) for line in lines if abs(line.amplitude) >= SMALLEST],
    }


def surface_summary(surface: SubharmonicSurface) -> dict[str, Any]:
    """A surface with all its values, amplitudes first."""
    return {
        "settings": surface.settings.model_dump(),
        "surface": surface.surface.model_dump(),
        "inducing_amplitude": plain(surface.inducing_amplitude),
        "inducing_frequency": plain(surface.inducing_frequency),
        "state": plain(surface.state),
        "difference": plain(surface.difference),
        "slow_amplitude": plain(surface.slow_amplitude),
        "slow_frequency": plain(surface.slow_frequency),
        "slow_rms": plain(surface.slow_rms),
        "slow_origin": plain(surface.slow_origin),
        "bias": plain(surface.bias),
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
