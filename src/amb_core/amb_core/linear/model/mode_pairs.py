"""Identified modes beside computed ones: pairs of close rate and like shape, and their relative errors.

Two shapes are compared by the modal assurance criterion (MAC): 1 for the same, 0 for orthogonal ones. Modes of almost
one rate mix at random, so a shape is compared with all that mixtures of them can form.

Source: R. J. Allemang, "The modal assurance criterion: twenty years of use and abuse", Sound and Vibration 37 (2003).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import IdentificationError
from amb_core.linear.model.modes import LEAST_GAIN, Mode, Modes

FARTHEST = 0.1
"""Distance of two rates, over the computed one, above which modes are not paired."""
LEAST_ALIKE = 0.7
"""Modal assurance criterion below which modes are not paired."""
_ALMOST_ONE_RATE = 0.01
_REFUSED = 1e3  # cost of a pair that must not be: more than that of all others together


@dataclass(frozen=True, eq=False)
class ModePair:
    """A computed mode with the identified one.

    Attributes
    ----------
    computed, identified : Mode
        The two.
    assurance : float
        Modal assurance criterion of their shapes, 0 to 1.
    """

    computed: Mode
    identified: Mode
    assurance: float

    @property
    def frequency_error(self) -> float:
        """Identified over computed natural frequency, minus one."""
        return self.identified.natural_hz / self.computed.natural_hz - 1.0

    @property
    def damping_error(self) -> float:
        """Identified minus computed damping ratio."""
        return self.identified.damping_ratio - self.computed.damping_ratio

    def to_json(self) -> dict[str, Any]:
        """Frequencies (Hz), damping ratios and whirl of both, and the error of the frequency in percent."""
        both = {"computed": self.computed, "identified": self.identified}
        return {
            "kind": self.computed.kind,
            **{
                f"{name}_{part}": getattr(mode, part)
                for name, mode in both.items()
                for part in ("natural_hz", "damping_ratio", "whirl")
            },
            "frequency_error_percent": 100.0 * self.frequency_error,
            "assurance": self.assurance,
        }


@dataclass(frozen=True, eq=False)
class ModeComparison:
    """Pairs, computed modes slowest first, and the modes of either side that have no partner."""

    pairs: tuple[ModePair, ...]
    missing: tuple[Mode, ...]
    surplus: tuple[Mode, ...]

    def worst(self, *kinds: str) -> float | None:
        """Largest magnitude of the relative frequency error of some kinds of modes; None if one of them is missing.

        None also where no mode of these kinds was computed.
        """
        chosen = [pair for pair in self.pairs if pair.computed.kind in kinds]
        if not chosen or any(mode.kind in kinds for mode in self.missing):
            return None
        return max(abs(pair.frequency_error) for pair in chosen)


def pair_modes(
    identified: Modes,
    computed: Modes,
    *,
    farthest: float = FARTHEST,
    least_alike: float = LEAST_ALIKE,
    least_gain: float = LEAST_GAIN,
) -> ModeComparison:
    """Pair identified with computed modes so that all pairs together are as close as possible.

    Parameters
    ----------
    identified, computed : Modes
        Both of the plant, or both of its closed loop, with the same outputs.
    farthest : float, optional
        Largest distance of two rates, over the computed one.
    least_alike : float, optional
        Smallest modal assurance criterion of two shapes.
    least_gain : float, optional
        Relative gain below which computed modes are left out, and identified ones without a partner are no `surplus`.
        A tenth of it makes an identified mode a partner: gains are estimates.

    Raises
    ------
    IdentificationError
        If the two do not have the same outputs.
    """
    from scipy.optimize import linear_sum_assignment  # takes a quarter of a second to import

    if identified.output_names != computed.output_names:
        raise IdentificationError(
            f"modes at the outputs {', '.join(identified.output_names)} cannot be paired with modes at "
            f"{', '.join(computed.output_names)}; both models need the same outputs in the same order"
        )
    wanted, candidates = computed.selected(least_gain).modes, identified.selected(0.1 * least_gain).modes
    assurance = np.array([[_assurance(one, other, wanted) for one in candidates] for other in wanted])
    assurance = assurance.reshape(len(wanted), len(candidates))
    distance = np.abs(np.subtract.outer(_rates(wanted), _rates(candidates))) / np.abs(_rates(wanted))[:, np.newaxis]
    allowed = (distance <= farthest) & (assurance >= least_alike)
    cost = np.where(allowed, distance / farthest + 1.0 - assurance, _REFUSED)
    rows, columns = linear_sum_assignment(cost)
    chosen = [(int(row), int(column)) for row, column in zip(rows, columns, strict=True) if allowed[row, column]]
    partners = {row for row, _ in chosen}, {column for _, column in chosen}
    return ModeComparison(
        tuple(ModePair(wanted[row], candidates[column], float(assurance[row, column])) for row, column in chosen),
        tuple(mode for row, mode in enumerate(wanted) if row not in partners[0]),
        tuple(mode for column, mode in enumerate(candidates) if column not in partners[1] and mode.gain >= least_gain),
    )


def _rates(modes: Sequence[Mode]) -> NDArray[np.complex128]:
    return np.array([mode.rate for mode in modes], dtype=np.complex128)


def _assurance(one: Mode, other: Mode, among: Sequence[Mode]) -> float:
    """Share of a shape that lies in the span of the shapes of the computed modes with almost the rate of `other`."""
    near = [mode for mode in among if abs(mode.rate - other.rate) <= _ALMOST_ONE_RATE * abs(other.rate)]
    left, singular, _ = np.linalg.svd(np.column_stack([mode.shape for mode in near]), full_matrices=False)
    span = left[:, singular > 1e-3 * singular[0]]
    return float(np.linalg.norm(span.conj().T @ one.shape) ** 2 / np.linalg.norm(one.shape) ** 2)
