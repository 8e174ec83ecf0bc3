"""Field in the iron from its flux density, compiled: hysteresis after Jiles and Atherton, or a single-valued curve.

The iron elements of a bearing lie side by side, and the loops over them have no branches, so that they become vector
instructions. Products and sums are fused where that is written (`_fma`, IEEE 754-2008): the
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

from collections.abc import Callable
from math import copysign
from typing import Any, cast

import numba
import numpy as np
from numba import types
from numba.extending import intrinsic
from scipy.constants import mu_0

from amb_core.plant.kernel.langevin import ASYMPTOTE_FROM, DENOMINATOR, NUMERATOR
from amb_core.plant.kernel.records import CURVE_INTERVALS, ELEMENTS

RELUCTIVITY = 1.0 / mu_0
_FAR = ASYMPTOTE_FROM**2


def _typed_fma(typingctx: Any, x: Any, y: Any, z: Any) -> Any:
    """X y + z, rounded once."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.fma(*arguments)

    return types.float64(types.float64, types.float64, types.float64), generate


_fma = cast(Callable[[Any, Any, Any], Any], intrinsic(_typed_fma))


@numba.njit(cache=True, error_model="numpy")
def advance_hysteresis(iron, material):
    """Move all elements from their flux densities to their targets along their hysteresis loops.

    One evaluation of the slope dM/dB in the middle of the step, where the last slope predicts the magnetisation, then
    one Newton step of the implicit midpoint rule with the stiff part of the Jacobian: second order between reversals,
    and stable however far the step reaches into saturation. Steps that do not resolve the knee, about 20 mT wide, let
    the magnetisation overshoot there, by a part of step / mu0. An element whose flux density stays is left as it is.

    Parameters
    ----------
    iron : record IRON
        The elements, changed in place.
    material : record MATERIAL
        From `pack_material`.
    """
    _predict(iron, material)
    _evaluate_langevin(iron)
    _correct(iron, material)


@numba.njit(inline="always", error_model="numpy")
def _predict(iron, material):
    """Magnetisation in the middle of the step, and the argument H_e / a of the Langevin function there."""
    per_b = material.argument_per_b
    per_m = material.argument_per_m
    for n in range(ELEMENTS):
        step = 0.5 * (iron.target[n] - iron.flux_density[n])
        magnetisation = _fma(step, iron.slope[n], iron.magnetisation[n])
        iron.midpoint[n] = magnetisation
        iron.argument[n] = _fma(per_b, iron.flux_density[n] + step, -per_m * magnetisation)


@numba.njit(inline="always", error_model="numpy")
def _evaluate_langevin(iron):
    """Numerator and denominator of L(x) / x; undivided, so that the whole step needs a single division."""
    for n in range(ELEMENTS):
        x = iron.argument[n]
        z = x * x
        far = z > _FAR
        iron.numerator[n] = abs(x) - 1.0 if far else _polynomial(NUMERATOR, z)
        iron.denominator[n] = z if far else _polynomial(DENOMINATOR, z)


@numba.njit(inline="always", error_model="numpy")
def _polynomial(c: tuple[float, ...], z: float) -> float:
    """Polynomial of degree 9, lowest coefficient first (Estrin's scheme: short chains of dependent operations)."""
    z2 = z * z
    z4 = z2 * z2
    low = _fma(z2, _fma(z, c[3], c[2]), _fma(z, c[1], c[0]))
    high = _fma(z2, _fma(z, c[7], c[6]), _fma(z, c[5], c[4]))
    return _fma(z4 * z4, _fma(z, c[9], c[8]), _fma(z4, high, low))


@numba.njit(inline="always", error_model="numpy")
def _correct(iron, material):
    """Slope over the whole step, and what follows from it.

    Up to the slope, all is multiplied by the square of the Langevin function's denominator, `one`.
    """
    saturation = material.saturation
    susceptibility = material.susceptibility
    uncoupled = material.uncoupled
    pinning = material.pinning
    reversibility = material.reversibility
    damping = material.damping
    for n in range(ELEMENTS):
        target = iron.target[n]
        step = target - iron.flux_density[n]
        x = iron.argument[n]
        numerator = iron.numerator[n]
        one = iron.denominator[n] * iron.denominator[n]
        product = numerator * iron.denominator[n]
        lag = _fma(saturation * x, product, -iron.midpoint[n] * one)  # M_an - M
        irreversible = lag * copysign(pinning, step)
        moving = irreversible > 0.0
        irreversible = irreversible if moving else 0.0
        # dM_an/dH_e, with L'(x) = 1 - L^2 - 2 L / x
        anhysteretic = susceptibility * _fma(-numerator * numerator, x * x, _fma(-2.0, product, one))
        chi = _fma(reversibility, anhysteretic, irreversible)
        drag = _fma(uncoupled, chi, one)  # 1 + (1 - alpha) chi
        stiffness = damping * abs(step) * one * _fma(uncoupled, anhysteretic, one)  # of the pull of M towards M_an
        old = iron.slope[n]
        change = drag * _fma(-old, drag, chi * RELUCTIVITY) / _fma(drag, drag, stiffness if moving else 0.0)
        slope = max(old + (change if step != 0.0 else 0.0), 0.0)
        magnetisation = _fma(slope, step, iron.magnetisation[n])
        field = _fma(target, RELUCTIVITY, -magnetisation)
        iron.work[n] = _fma(0.5 * step, iron.field[n] + field, iron.work[n])
        iron.flux_density[n] = target
        iron.magnetisation[n] = magnetisation
        iron.slope[n] = slope
        iron.field[n] = field


@numba.njit(cache=True, error_model="numpy")
def follow_curve(iron, curve):
    """Move all elements from their flux densities to their targets along a single-valued curve.

    Parameters
    ----------
    iron : record IRON
        The elements, changed in place.
    curve : record CURVE
        From `pack_curve`.
    """
    scale = curve.scale
    for n in range(ELEMENTS):
        target = iron.target[n]
        place = abs(target) * scale
        interval = np.intp(min(place, float(CURVE_INTERVALS)))
        t = place - interval
        a, b = curve.coefficients[interval, 0], curve.coefficients[interval, 1]
        c, d = curve.coefficients[interval, 2], curve.coefficients[interval, 3]
        field = copysign(_fma(t, _fma(t, _fma(t, d, c), b), a), target)
        step = target - iron.flux_density[n]
        iron.work[n] = _fma(0.5 * step, iron.field[n] + field, iron.work[n])
        iron.flux_density[n] = target
        iron.magnetisation[n] = _fma(target, RELUCTIVITY, -field)
        iron.slope[n] = RELUCTIVITY - scale * _fma(t, _fma(3.0 * t, d, 2.0 * c), b)
        iron.field[n] = field
