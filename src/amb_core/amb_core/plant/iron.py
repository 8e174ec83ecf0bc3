"""The magnetic material of poles, back iron and journal: its single-valued curve, and its constants for the kernel.

The curve is the anhysteretic one of the Jiles-Atherton parameters, M = M_s L(H_e / a) with H_e = H + alpha M and the
Langevin function L, or a user's table. Hysteresis loops run about it (`amb_core.plant.kernel.iron`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.constants import mu_0

from amb_core.ground.errors import PlantError
from amb_core.plant.bh_table import read_bh_table
from amb_core.plant.kernel.langevin import langevin
from amb_core.plant.kernel.records import CURVE, CURVE_INTERVALS, IRON, MATERIAL
from amb_core.plant.parameters import IronParameters

_SPAN = 2.0  # of the table of an anhysteretic curve, in mu0 M_s
_DAMPING = 9.0 / 16.0
"""Share of the stiff Jacobian in the Newton step; for long steps it damps the lag of M behind M_an fastest."""


@dataclass(frozen=True)
class SaturationCurve:
    """Field as a single-valued, odd, rising function of the flux density: piecewise cubic, then a line of slope 1/mu0.

    Attributes
    ----------
    end : float
        Flux density where the straight line begins (T).
    coefficients : ndarray, shape (intervals + 1, 4)
        Coefficients of each interval and of the straight line (A/m), lowest power first; the variable is the position
        within the interval (0 to 1).
    """

    end: float
    coefficients: NDArray[np.float64]

    def field(self, flux_density: NDArray[np.float64]) -> NDArray[np.float64]:
        """Field (A/m) at flux densities (T)."""
        place, c = self._locate(flux_density)
        return np.sign(flux_density) * (c[..., 0] + place * (c[..., 1] + place * (c[..., 2] + place * c[..., 3])))

    def differential_reluctivity(self, flux_density: NDArray[np.float64]) -> NDArray[np.float64]:
        """Slope dH/dB (m/H) at flux densities (T)."""
        place, c = self._locate(flux_density)
        return self.scale * (c[..., 1] + place * (2.0 * c[..., 2] + place * 3.0 * c[..., 3]))

    @property
    def scale(self) -> float:
        """Intervals per tesla."""
        return (len(self.coefficients) - 1) / self.end

    def _locate(self, flux_density: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        place = np.abs(flux_density) * self.scale
        interval = np.minimum(place, len(self.coefficients) - 1).astype(np.intp)
        return place - interval, self.coefficients[interval]


def saturation_curve(parameters: IronParameters) -> SaturationCurve:
    """Curve of the material: from its table if it has one, otherwise anhysteretic.

    Parameters
    ----------
    parameters : IronParameters
        The material.

    Raises
    ------
    PlantError
        If the table cannot be used or the Jiles-Atherton parameters have no stable anhysteretic curve.
    """
    if parameters.bh_table:
        from scipy.interpolate import PchipInterpolator  # takes a quarter of a second to import

        field, flux_density = read_bh_table(parameters.bh_table)
        odd = PchipInterpolator(
            np.concatenate([-flux_density[:0:-1], flux_density]), np.concatenate([-field[:0:-1], field])
        )
        grid = np.linspace(0.0, flux_density[-1], CURVE_INTERVALS + 1)
        values, slopes = odd(grid), odd(grid, 1)
        # Within these bounds an interpolant rises (Fritsch, Carlson 1980); they matter only at kinks of the table.
        secants = np.diff(values) * CURVE_INTERVALS / grid[-1]
        slopes[1:] = np.minimum(slopes[1:], 3.0 * secants)
        slopes[:-1] = np.minimum(slopes[:-1], 3.0 * secants)
    else:
        grid = np.linspace(0.0, _SPAN * mu_0 * parameters.saturation_magnetisation, CURVE_INTERVALS + 1)
        values, slopes = anhysteretic_field(grid, parameters)
    interval = grid[-1] / CURVE_INTERVALS
    coefficients = np.zeros((CURVE_INTERVALS + 1, 4))
    coefficients[:-1] = _hermite(grid, values, slopes) * interval ** np.arange(4)
    coefficients[-1, :2] = values[-1], interval / mu_0
    return SaturationCurve(float(grid[-1]), coefficients)


def _hermite(
    grid: NDArray[np.float64], values: NDArray[np.float64], slopes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Coefficients of the cubics with these values and slopes at the grid, lowest power first, one row an interval."""
    secant = np.diff(values) / np.diff(grid)
    bend = (slopes[:-1] + slopes[1:] - 2.0 * secant) / np.diff(grid)
    return np.column_stack(
        [values[:-1], slopes[:-1], (secant - slopes[:-1]) / np.diff(grid) - bend, bend / np.diff(grid)]
    )


def anhysteretic_field(
    flux_density: NDArray[np.float64], parameters: IronParameters
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Field H (A/m) on the anhysteretic curve, and its slope dH/dB (m/H).

    Parameters
    ----------
    flux_density : ndarray
        Flux density (T).
    parameters : IronParameters
        The material.

    Raises
    ------
    PlantError
        If the anhysteretic curve is not stable.
    """
    check_stability(parameters)
    saturation, a = parameters.saturation_magnetisation, parameters.anhysteretic_field
    alpha = parameters.interdomain_coupling
    # B / mu0 = a x + (1 - alpha) M_s L(x) with x = H_e / a, rising and concave: Newton from below climbs to the root.
    wanted = np.abs(flux_density) / mu_0
    x = wanted / (a + (1.0 - alpha) * saturation / 3.0)
    for _ in range(100):
        value, slope = langevin(x)
        change = (wanted - a * x - (1.0 - alpha) * saturation * value) / (a + (1.0 - alpha) * saturation * slope)
        x = x + change
        if np.all(np.abs(change) <= 1e-13 * x):
            break
    value, slope = langevin(x)
    susceptibility = saturation / a * slope
    field = np.sign(flux_density) * (a * x - alpha * saturation * value)
    return field, (1.0 - alpha * susceptibility) / (mu_0 * (1.0 + (1.0 - alpha) * susceptibility))


def check_stability(parameters: IronParameters) -> None:
    """Refuse Jiles-Atherton parameters with an anhysteretic curve that would turn back at the origin.

    Raises
    ------
    PlantError
        If alpha M_s / (3 a) >= 1.
    """
    saturation, a = parameters.saturation_magnetisation, parameters.anhysteretic_field
    alpha = parameters.interdomain_coupling
    feedback = alpha * saturation / (3.0 * a)
    if feedback >= 1.0:
        raise PlantError(
            f"iron: interdomain_coupling = {alpha:g} with saturation_magnetisation = {saturation:g} A/m and "
            f"anhysteretic_field = {a:g} A/m magnetises itself, alpha M_s / (3 a) = {feedback:.3g}; "
            f"allowed: less than 1, that is interdomain_coupling below {3.0 * a / saturation:.3g}"
        )


def pack_curve(parameters: IronParameters) -> np.void:
    """Curve of the material as the record that `follow_curve` takes; raises as `saturation_curve`."""
    curve = saturation_curve(parameters)
    record: np.void = np.zeros(1, CURVE)[0]
    record["scale"] = curve.scale
    record["coefficients"] = curve.coefficients
    return record


def pack_material(parameters: IronParameters) -> np.void:
    """Constants of the material as the record that `advance_hysteresis` takes.

    Raises
    ------
    PlantError
        If the anhysteretic curve is not stable.
    """
    check_stability(parameters)
    a = parameters.anhysteretic_field
    uncoupled = 1.0 - parameters.interdomain_coupling
    record: np.void = np.zeros(1, MATERIAL)[0]
    record["saturation"] = parameters.saturation_magnetisation
    record["susceptibility"] = parameters.saturation_magnetisation / a
    record["argument_per_b"] = 1.0 / (mu_0 * a)
    record["argument_per_m"] = uncoupled / a
    record["uncoupled"] = uncoupled
    record["pinning"] = 1.0 / parameters.pinning_field
    record["reversibility"] = parameters.reversibility
    record["damping"] = _DAMPING / (mu_0 * parameters.pinning_field)
    return record


def initial_iron(flux_density: NDArray[np.float64], parameters: IronParameters) -> np.void:
    """Iron with every element on the single-valued curve: demagnetised, then brought to its flux density.

    Parameters
    ----------
    flux_density : ndarray, shape (24,)
        Flux densities (T).
    parameters : IronParameters
        The material.

    Returns
    -------
    record IRON
        The elements; no work done yet.

    Raises
    ------
    PlantError
        As `saturation_curve`.
    """
    curve = saturation_curve(parameters)
    iron: np.void = np.zeros(1, IRON)[0]
    iron["target"] = iron["flux_density"] = flux_density
    iron["field"] = curve.field(flux_density)
    iron["magnetisation"] = flux_density / mu_0 - iron["field"]
    reluctivity = curve.differential_reluctivity(flux_density)
    iron["slope"] = 1.0 / mu_0 - reluctivity
    if parameters.hysteresis:  # only the reversible part moves at first
        alpha = parameters.interdomain_coupling
        chi = parameters.reversibility * iron["slope"] / (reluctivity + alpha * iron["slope"])
        iron["slope"] = chi / (mu_0 * (1.0 + (1.0 - alpha) * chi))
    return iron
