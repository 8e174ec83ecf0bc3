"""Field in the iron from its flux density, compiled: hysteresis after Jiles and Atherton, or a single-valued curve.

The iron elements of a bearing lie side by side in the rows of one array, and the loops over them have no branches, so
that they become vector instructions. Products and sums are fused where that is written (`_fma`, IEEE 754-2008): the
same bits come out on every machine.

Hysteresis is the Jiles-Atherton model [1]_ in its inverse, flux-density driven form [2]_, [3]_. With the effective
field H_e = H + alpha M, the anhysteretic magnetisation M_an = M_s L(H_e / a), L the Langevin function, and the
direction delta = sign(dB/dt),

    dM/dH_e = chi = max(0, delta (M_an - M)) / k + c dM_an/dH_e,    dM/dB = chi / (mu0 (1 + (1 - alpha) chi)).

The first term is the irreversible part (1 - c) dM_irr/dH_e, with M = (1 - c) M_irr + c M_an; where it would let the
magnetisation fall in a rising field it is cut off, as domain walls then stay pinned. Minor loops follow from the same
equations; as in every Jiles-Atherton model without further rules they close only as they are repeated.

References
----------
.. [1] Jiles, Atherton, "Theory of ferromagnetic hysteresis", J. Magn. Magn. Mater. 61 (1986).
.. [2] Sadowski, Batistela, Bastos, Lajoie-Mazenc, "An inverse Jiles-Atherton model to take into account hysteresis in
   time-stepping finite-element calculations", IEEE Trans. Magn. 38 (2002).
.. [3] Leite, Sadowski, Kuo-Peng, Batistela, Bastos, Espindola, "Inverse Jiles-Atherton vector hysteresis model",
   IEEE Trans. Magn. 40 (2004).
"""

from __future__ import annotations

from math import copysign
from typing import Any

import numba
import numpy as np
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray
from scipy.constants import mu_0

from amb_core.plant.kernel.langevin import ASYMPTOTE_FROM, DENOMINATOR, NUMERATOR
from amb_core.plant.kernel.pointers import data
from amb_core.plant.network import POLES

ELEMENTS = 3 * POLES
"""Iron elements of a bearing: poles, back-iron segments, journal segments."""

# Rows of the iron array, 24 columns
TARGET = 0  # flux density to go to (T), written by the caller
FLUX_DENSITY = 1  # (T)
MAGNETISATION = 2  # (A/m)
SLOPE = 3  # dM/dB of the last step (A/(m T))
FIELD = 4  # (A/m)
WORK = 5  # integral of H dB since the start (J/m^3), trapezoidal
_MIDPOINT, _ARGUMENT, _NUMERATOR, _DENOMINATOR = range(6, 10)  # scratch
ROWS = 10

# Material vector
SATURATION, SUSCEPTIBILITY, ARGUMENT_PER_B, ARGUMENT_PER_M, UNCOUPLED, PINNING, REVERSIBILITY, DAMPING = range(8)
MATERIAL_SIZE = 8

# Curve array, 4 columns: a row of intervals per tesla and number of intervals, then the coefficients of each interval
# and of the straight line beyond, lowest power first
CURVE_SCALE, CURVE_INTERVALS = 0, 1

RELUCTIVITY = 1.0 / mu_0
_FAR = ASYMPTOTE_FROM**2


@intrinsic
def _fma(typingctx: Any, x: Any, y: Any, z: Any) -> Any:
    """X y + z, rounded once."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.fma(*arguments)

    return types.float64(types.float64, types.float64, types.float64), generate


@numba.njit(cache=True, error_model="numpy")
def advance_hysteresis(iron: NDArray[np.float64], material: NDArray[np.float64]) -> None:
    """Move all elements from their flux densities to TARGET along their hysteresis loops.

    One evaluation of the slope dM/dB in the middle of the step, where the last slope predicts the magnetisation, then
    one Newton step of the implicit midpoint rule with the stiff part of the Jacobian: second order between reversals,
    and stable however far the step reaches into saturation. Steps that do not resolve the knee, about 20 mT wide, let
    the magnetisation overshoot there, by a part of step / mu0. An element whose flux density stays is left as it is.

    Parameters
    ----------
    iron : ndarray, shape (ROWS or more, 24)
        Iron array, changed in place.
    material : ndarray, shape (8,)
        From `pack_material`.
    """
    # Rows at distances known to the compiler: it need not check whether they overlap.
    flat = numba.carray(data(iron), ROWS * ELEMENTS)
    _predict(flat, material)
    _evaluate_langevin(flat)
    _correct(flat, material)


@numba.njit(inline="always", error_model="numpy")
def _predict(iron: NDArray[np.float64], material: NDArray[np.float64]) -> None:
    """Magnetisation in the middle of the step, and the argument H_e / a of the Langevin function there."""
    per_b = material[ARGUMENT_PER_B]
    per_m = material[ARGUMENT_PER_M]
    for n in range(ELEMENTS):
        step = 0.5 * (iron[TARGET * ELEMENTS + n] - iron[FLUX_DENSITY * ELEMENTS + n])
        magnetisation = _fma(step, iron[SLOPE * ELEMENTS + n], iron[MAGNETISATION * ELEMENTS + n])
        iron[_MIDPOINT * ELEMENTS + n] = magnetisation
        iron[_ARGUMENT * ELEMENTS + n] = _fma(per_b, iron[FLUX_DENSITY * ELEMENTS + n] + step, -per_m * magnetisation)


@numba.njit(inline="always", error_model="numpy")
def _evaluate_langevin(iron: NDArray[np.float64]) -> None:
    """Numerator and denominator of L(x) / x; undivided, so that the whole step needs a single division."""
    for n in range(ELEMENTS):
        x = iron[_ARGUMENT * ELEMENTS + n]
        z = x * x
        far = z > _FAR
        iron[_NUMERATOR * ELEMENTS + n] = abs(x) - 1.0 if far else _polynomial(NUMERATOR, z)
        iron[_DENOMINATOR * ELEMENTS + n] = z if far else _polynomial(DENOMINATOR, z)


@numba.njit(inline="always", error_model="numpy")
def _polynomial(c: tuple[float, ...], z: float) -> float:
    """Polynomial of degree 9, lowest coefficient first (Estrin's scheme: short chains of dependent operations)."""
    z2 = z * z
    z4 = z2 * z2
    low = _fma(z2, _fma(z, c[3], c[2]), _fma(z, c[1], c[0]))
    high = _fma(z2, _fma(z, c[7], c[6]), _fma(z, c[5], c[4]))
    return _fma(z4 * z4, _fma(z, c[9], c[8]), _fma(z4, high, low))


@numba.njit(inline="always", error_model="numpy")
def _correct(iron: NDArray[np.float64], material: NDArray[np.float64]) -> None:
    """Slope over the whole step, and what follows from it.

    Up to the slope, all is multiplied by the square of the Langevin function's denominator, `one`.
    """
    saturation = material[SATURATION]
    susceptibility = material[SUSCEPTIBILITY]
    uncoupled = material[UNCOUPLED]
    pinning = material[PINNING]
    reversibility = material[REVERSIBILITY]
    damping = material[DAMPING]
    for n in range(ELEMENTS):
        target = iron[TARGET * ELEMENTS + n]
        step = target - iron[FLUX_DENSITY * ELEMENTS + n]
        x = iron[_ARGUMENT * ELEMENTS + n]
        numerator = iron[_NUMERATOR * ELEMENTS + n]
        one = iron[_DENOMINATOR * ELEMENTS + n] * iron[_DENOMINATOR * ELEMENTS + n]
        product = numerator * iron[_DENOMINATOR * ELEMENTS + n]
        lag = _fma(saturation * x, product, -iron[_MIDPOINT * ELEMENTS + n] * one)  # M_an - M
        irreversible = lag * copysign(pinning, step)
        moving = irreversible > 0.0
        irreversible = irreversible if moving else 0.0
        # dM_an/dH_e, with L'(x) = 1 - L^2 - 2 L / x
        anhysteretic = susceptibility * _fma(-numerator * numerator, x * x, _fma(-2.0, product, one))
        chi = _fma(reversibility, anhysteretic, irreversible)
        drag = _fma(uncoupled, chi, one)  # 1 + (1 - alpha) chi
        stiffness = damping * abs(step) * one * _fma(uncoupled, anhysteretic, one)  # of the pull of M towards M_an
        old = iron[SLOPE * ELEMENTS + n]
        change = drag * _fma(-old, drag, chi * RELUCTIVITY) / _fma(drag, drag, stiffness if moving else 0.0)
        slope = max(old + (change if step != 0.0 else 0.0), 0.0)
        magnetisation = _fma(slope, step, iron[MAGNETISATION * ELEMENTS + n])
        field = _fma(target, RELUCTIVITY, -magnetisation)
        iron[WORK * ELEMENTS + n] = _fma(0.5 * step, iron[FIELD * ELEMENTS + n] + field, iron[WORK * ELEMENTS + n])
        iron[FLUX_DENSITY * ELEMENTS + n] = target
        iron[MAGNETISATION * ELEMENTS + n] = magnetisation
        iron[SLOPE * ELEMENTS + n] = slope
        iron[FIELD * ELEMENTS + n] = field


@numba.njit(cache=True, error_model="numpy")
def advance_saturation(iron: NDArray[np.float64], curve: NDArray[np.float64]) -> None:
    """Move all elements from their flux densities to TARGET along a single-valued curve.

    Parameters
    ----------
    iron : ndarray, shape (ROWS or more, 24)
        Iron array, changed in place.
    curve : ndarray, shape (intervals + 2, 4)
        From `pack_curve`.
    """
    flat = numba.carray(data(iron), ROWS * ELEMENTS)
    scale = curve[0, CURVE_SCALE]
    intervals = curve[0, CURVE_INTERVALS]
    for n in range(ELEMENTS):
        target = flat[TARGET * ELEMENTS + n]
        place = abs(target) * scale
        interval = np.intp(min(place, intervals))
        t = place - interval
        row = interval + 1
        a, b, c, d = curve[row, 0], curve[row, 1], curve[row, 2], curve[row, 3]
        field = copysign(_fma(t, _fma(t, _fma(t, d, c), b), a), target)
        step = target - flat[FLUX_DENSITY * ELEMENTS + n]
        flat[WORK * ELEMENTS + n] = _fma(0.5 * step, flat[FIELD * ELEMENTS + n] + field, flat[WORK * ELEMENTS + n])
        flat[FLUX_DENSITY * ELEMENTS + n] = target
        flat[MAGNETISATION * ELEMENTS + n] = _fma(target, RELUCTIVITY, -field)
        flat[SLOPE * ELEMENTS + n] = RELUCTIVITY - scale * _fma(t, _fma(3.0 * t, d, 2.0 * c), b)
        flat[FIELD * ELEMENTS + n] = field
