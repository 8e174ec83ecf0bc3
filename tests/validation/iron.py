"""The iron of the plant's integrator against an independent solution of the Jiles-Atherton equations, and its limits.

The independent solution takes the equations as Sadowski et al. (2002) print them, with the irreversible magnetisation,
the Langevin function from Bessel functions, and an integrator of order eight that stops where the walls begin to move.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.constants import mu_0
from scipy.integrate import quad, solve_ivp, trapezoid
from scipy.optimize import brentq
from scipy.special import ive

from amb_core.plant.iron import anhysteretic_field, initial_iron, pack_material, saturation_curve
from amb_core.plant.kernel.iron import advance_hysteresis
from amb_core.plant.kernel.langevin import ASYMPTOTE_FROM, langevin
from amb_core.plant.kernel.records import ELEMENTS
from amb_core.plant.parameters import IronParameters
from tests.validation.row import Row

STEEL = IronParameters(
    saturation=True,
    hysteresis=True,
    saturation_magnetisation=1_145_220.0,
    anhysteretic_field=59.5,
    interdomain_coupling=1.3e-4,
    pinning_field=99.2,
    reversibility=0.54,
)
"""Laminated silicon steel of Gyselinck, Dular, Sadowski, Leite, Bastos, COMPEL 23 (2004)."""
LONGEST_STEP = 2.2e-3  # T: 300 V on the paper's bearing for 0.5 us
LIMIT = 1e-3


def rows() -> Iterator[Row]:
    """Relative deviations of major loops, order, closure of minor loops, and limits."""
    x = np.concatenate([np.logspace(-8, 4, 2000), np.linspace(0.9, 1.1, 2000) * ASYMPTOTE_FROM])
    deviation = np.abs(langevin(x)[0] * ive(0.5, x) / ive(1.5, x) - 1.0).max()
    yield Row("iron, Langevin function 1e-8 to 1e4: relative to Bessel functions", float(deviation), 1e-10, "-")
    for peak in (0.5, 1.0, 1.3):
        exact = _independent_loop(STEEL, peak)
        for name, shape in (("triangle", _triangle), ("sine", _sine)):
            loop = _loop(STEEL, shape(peak))
            for quantity in ("coercivity", "remanence", "loop area"):
                measured, expected = loop[quantity], exact[quantity]
                where = f"iron, {quantity}, {peak:g} T {name}, steps up to 2.2 mT"
                yield Row(f"{where}: relative", abs(measured / expected - 1.0), LIMIT, "-")
    yield Row("iron, order along a branch: deviation from 2", abs(_order(STEEL) - 2.0), 0.05, "-")
    yield Row("iron, reported work of a closed loop: relative to its area", _closure_of_work(STEEL), 1e-9, "-")
    yield Row("iron, minor loop 0.5 T +- 50 mT: drift of the field in cycle 100", _minor_drift(STEEL), 1e-3, "A/m")
    reversible = STEEL.model_copy(update={"reversibility": 1.0})
    path = _triangle(1.2)
    deviation = np.abs(_follow(reversible, path)[0] - saturation_curve(STEEL).field(path)).max()
    yield Row("iron, all reversible: field off the anhysteretic curve, 1.2 T", float(deviation), 0.1, "A/m")
    path = np.linspace(0.0, 4.0, 2001)
    fields, _ = _follow(STEEL, path)
    incremental = (fields[-1] - fields[-2]) / (path[-1] - path[-2]) * mu_0
    yield Row("iron, saturated at 4 T: slope relative to air", float(abs(incremental - 1.0)), 1e-4, "-")
    flux_density = np.linspace(1e-6, 2.8, 20_001)
    table = saturation_curve(STEEL).field(flux_density) / anhysteretic_field(flux_density, STEEL)[0]
    yield Row("iron, tabulated curve to 2.8 T: relative to its equation", float(np.abs(table - 1.0).max()), 1e-6, "-")


def _sweep(
    shape: Callable[[NDArray[np.float64]], NDArray[np.float64]], peak: float, steepest: float
) -> NDArray[np.float64]:
    """Initial rise and two cycles, no step longer than LONGEST_STEP."""
    steps = 4 * int(np.ceil(steepest * peak / LONGEST_STEP / 4.0))
    return peak * shape(np.arange(steps // 4 + 2 * steps + 1) / steps)


def _triangle(peak: float) -> NDArray[np.float64]:
    return _sweep(lambda turn: 1.0 - 4.0 * np.abs((turn + 0.25) % 1.0 - 0.5), peak, 4.0)


def _sine(peak: float) -> NDArray[np.float64]:
    return _sweep(lambda turn: np.sin(2.0 * np.pi * turn), peak, 2.0 * np.pi)


def _follow(parameters: IronParameters, path: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Field and work of the kernel along flux densities, from the demagnetised state."""
    iron, material = initial_iron(np.full(ELEMENTS, path[0]), parameters), pack_material(parameters)
    result = np.empty((len(path), 2))
    for n, flux_density in enumerate(path):
        iron["target"] = flux_density
        advance_hysteresis(iron, material)
        result[n] = iron["field"][0], iron["work"][0]
    return result[:, 0], result[:, 1]


def _loop(parameters: IronParameters, path: NDArray[np.float64]) -> dict[str, float]:
    fields, work = _follow(parameters, path)
    cycle = 4 * (len(path) - 1) // 9  # a quarter and two cycles
    falling = slice(len(path) - 1 - cycle, len(path) - cycle // 2)
    return {
        "coercivity": -float(np.interp(0.0, -path[falling], fields[falling])),
        "remanence": float(np.interp(0.0, -fields[falling], path[falling])),
        "loop area": float(work[-1] - work[-1 - cycle]),
    }


@dataclass(frozen=True)
class _Equations:
    """Inverse Jiles-Atherton equations; the state is the magnetisation M over the flux density B."""

    material: IronParameters
    direction: float

    def anhysteretic(self, flux_density: float, magnetisation: float) -> tuple[float, float]:
        m = self.material
        x = (flux_density / mu_0 - (1.0 - m.interdomain_coupling) * magnetisation) / m.anhysteretic_field
        size = max(abs(x), 1e-6)
        value = np.copysign(ive(1.5, size) / ive(0.5, size), x)
        slope = 1.0 - value**2 - 2.0 * abs(value) / size
        return m.saturation_magnetisation * value, m.saturation_magnetisation / m.anhysteretic_field * slope

    def lag(self, flux_density: float, state: NDArray[np.float64]) -> float:
        return self.direction * (self.anhysteretic(flux_density, state[0])[0] - state[0])

    def rate(self, moving: bool) -> Callable[[float, NDArray[np.float64]], list[float]]:
        m = self.material

        def slope(flux_density: float, state: NDArray[np.float64]) -> list[float]:
            total, c = state[0], m.reversibility
            anhysteretic, susceptibility = self.anhysteretic(flux_density, total)
            irreversible = (total - c * anhysteretic) / (1.0 - c)
            pull = (anhysteretic - irreversible) / (mu_0 * m.pinning_field * self.direction) if moving else 0.0
            above = (1.0 - c) * pull + c / mu_0 * susceptibility
            below = mu_0 * (1.0 - c) * (1.0 - m.interdomain_coupling) * pull
            return [above / (1.0 + below + c * (1.0 - m.interdomain_coupling) * susceptibility)]

        return slope


def _independent_loop(parameters: IronParameters, peak: float) -> dict[str, float]:
    """Coercivity (A/m), remanence (T) and area (J/m^3) of the second cycle after the demagnetised state."""
    magnetisation = 0.0
    pieces: list[tuple[float, float, Callable[[float], NDArray[np.float64]]]] = []
    corners = [0.0, peak, -peak, peak, -peak, peak]
    for start, stop in pairwise(corners):
        equations = _Equations(parameters, float(np.sign(stop - start)))

        def starts_to_move(b: float, state: NDArray[np.float64], equations: _Equations = equations) -> float:
            return equations.lag(b, state)

        starts_to_move.terminal, starts_to_move.direction = True, 1.0
        moving = start == 0.0
        while start != stop:
            solution = solve_ivp(
                equations.rate(moving),
                (start, stop),
                [magnetisation],
                method="DOP853",
                rtol=1e-10,
                atol=1e-4,
                dense_output=True,
                events=None if moving else starts_to_move,
            )
            pieces.append((start, solution.t[-1], solution.sol))
            start, magnetisation, moving = solution.t[-1], solution.y[0, -1], True

    def field(piece: tuple[float, float, Callable[[float], NDArray[np.float64]]], flux_density: float) -> float:
        return float(flux_density / mu_0 - piece[2](flux_density)[0])

    cycle = pieces[-4:]  # each branch begins with walls at rest
    falling = cycle[:2]
    at_zero = next(piece for piece in falling if piece[1] <= 0.0 <= piece[0])
    demagnetised = next(piece for piece in falling if field(piece, piece[0]) * field(piece, piece[1]) <= 0.0)
    return {
        "coercivity": -field(at_zero, 0.0),
        "remanence": brentq(lambda b: field(demagnetised, b), *demagnetised[:2], xtol=1e-12),
        "loop area": sum(
            quad(lambda b, piece=piece: field(piece, b), *piece[:2], epsabs=1e-6, epsrel=1e-8, limit=200)[0]
            for piece in cycle
        ),
    }


def _order(parameters: IronParameters) -> float:
    coarse, middle, fine = (_follow(parameters, np.linspace(0.0, 1.2, steps + 1))[0][-1] for steps in (500, 1000, 2000))
    return float(np.log2((coarse - middle) / (middle - fine)))


def _closure_of_work(parameters: IronParameters) -> float:
    path = _triangle(1.0)
    fields, work = _follow(parameters, path)
    cycle = 4 * (len(path) - 1) // 9
    area = trapezoid(fields[-cycle - 1 :], path[-cycle - 1 :])
    return float(abs((work[-1] - work[-1 - cycle]) / area - 1.0))


def _minor_drift(parameters: IronParameters) -> float:
    """Change of the field at the top of a biased minor loop from its 99th to its 100th cycle (A/m)."""
    steps = 200
    minor = 0.5 + 0.05 * np.sin(2.0 * np.pi * np.arange(100 * steps + steps // 4 + 1) / steps)
    fields, _ = _follow(parameters, np.concatenate([np.linspace(0.0, 1.3, 600), np.linspace(1.3, 0.5, 400), minor]))
    return float(abs(fields[-1] - fields[-1 - steps]))
