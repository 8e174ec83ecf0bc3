"""Wishes for `amb new`, drawn over all that its options allow: levitated, or refused in a designer's terms."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from amb_core.designs.tuning import Bearing, design_bearing
from amb_core.ground.errors import AmbError
from amb_core.ground.parameters import Declaration, declarations, validate

SEED = 4
WISHES = 300
ORDINARY = {
    "gap": (2e-4, 1e-3),
    "turns": (20, 300),
    "mass": (0.3, 30.0),
    "bias_current": (0.5, 8.0),
    "voltage": (24.0, 400.0),
    "sample_rate": (5e3, 3e4),
}
"""What every second wish keeps to; the others may ask for anything that is declared."""
INTERNAL = re.compile(
    r"reset the plant|sample \d|integration\.|magnetic_circuit\.|rotor\.|amplifier\.|Traceback|'\w+' ="
)
"""What only the simulator, or who wrote it, understands."""


def random_wish(generator: np.random.Generator, ordinary: bool) -> dict[str, Any]:
    """Values of the options, equally likely on a logarithmic scale; what is not needed is given every other time."""
    if ordinary:
        drawn = {name: _drawn(generator, *limits) for name, limits in ORDINARY.items()}
        return drawn | {"turns": round(drawn["turns"])}
    return {
        item.name: _value(generator, item)
        for item in declarations(Bearing)
        if Bearing.model_fields[item.name].is_required() or generator.random() < 0.5
    }


def _value(generator: np.random.Generator, item: Declaration) -> float | int:
    assert item.minimum is not None and item.maximum is not None
    value = _drawn(generator, item.minimum or 1e-4 * item.maximum, item.maximum)
    return int(value) if item.type is int else value


def _drawn(generator: np.random.Generator, low: float, high: float) -> float:
    return float(f"{np.exp(generator.uniform(np.log(low), np.log(high))):.3g}")


def measure(wishes: int = WISHES, seed: int = SEED) -> dict[str, Any]:
    """Counts of the wishes: drawn, levitated, explained, and internal, with the texts of the last."""
    generator = np.random.default_rng(seed)
    levitated, explained, internal = 0, 0, []
    for number in range(wishes):
        wish = random_wish(generator, ordinary=number % 2 == 0)
        try:
            design_bearing(validate(Bearing, wish))
            levitated += 1
        except AmbError as problem:
            if INTERNAL.search(str(problem)):
                internal.append(f"{wish}: {problem}")
            else:
                explained += 1
    return {
        "drawn": wishes,
        "levitated": levitated,
        "explained": explained,
        "internal": len(internal),
        "texts": internal,
    }
