"""The iron of the plant for an implicit solver; its equations stand in `implicit_plant`."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.constants import mu_0
from scipy.optimize import brentq

from amb_core.plant import Plant

ANGLES = np.deg2rad(22.5 + 45.0 * np.arange(8))
DIRECTIONS = np.column_stack([np.cos(ANGLES), np.sin(ANGLES)])


@dataclass(frozen=True)
class Block:
    """Where the state of a bearing lies: pole, circulating and delayed fluxes, fields, charges through the coils."""

    flux: slice
    circulating: slice
    delayed: slice
    field: slice
    charge: slice


class Iron:
    """Magnetic circuit of a bearing with shared flux; `derivative` and `jacobian` fill the rows of its state."""

    def __init__(self, plant: Plant) -> None:
        circuit, iron, network = plant.parameters.magnetic_circuit, plant.parameters.iron, plant.network
        self._gap, self._per_gap = circuit.air_gap, network.gap_reluctance
        self.pull = 0.5 * network.gap_reluctance
        # Unknowns: flux rates (8), magnetic potential between the rings (1), coil currents (4)
        system = np.zeros((13, 13))
        system[:8, :8], system[:8, 8], system[:8, 9:] = network.eddy_coefficient, 1.0, -network.winding
        system[8, :8] = 1.0
        system[9:, :8], system[9:, 9:] = network.winding.T, circuit.coil_resistance * np.eye(4)
        wanted = np.delete(np.linalg.inv(system), 8, axis=0)
        self._by_drop, self._by_voltage = -wanted[:, :8], wanted[:, 9:]

        delayed = 8 * sum(len(part.terms.rates) for part in network.diffusing)
        if not iron.saturation:
            paths = []
        else:
            paths = [(np.eye(8), *network.paths[0]), *((network.to_segments, *path) for path in network.paths[1:])]
            paths = paths[:2] if iron.solid_journal else paths
        rings = max(len(paths) - 1, 0)
        self._sizes = (8, rings, delayed, 8 * len(paths), 4)
        self.size = sum(self._sizes)
        local = self.block(0)
        # Drops along the poles from the state: linear iron, delayed fluxes, fields
        self._drops = np.zeros((8, self.size - 4))
        self._drops[:, local.flux] = network.iron_reluctance
        weighted = [np.kron(part.terms.weights, part.reluctance) for part in network.diffusing]
        self._drops[:, local.delayed] = -np.hstack([np.zeros((8, 0)), *weighted])
        self._lags = np.repeat(np.concatenate([np.zeros(0), *(part.terms.rates for part in network.diffusing)]), 8)
        for part in network.diffusing:
            self._drops[:, local.flux] += part.terms.weights.sum() * part.reluctance
        # Flux densities of the elements from pole and circulating fluxes, and rates of the latter from the fields
        self._density = np.zeros((8 * len(paths), 8 + rings))
        self._circulation = np.zeros((rings, 8 * len(paths)))
        for number, (segments, length, area) in enumerate(paths):
            rows = slice(8 * number, 8 * number + 8)
            self._drops[:, local.field.start + rows.start : local.field.start + rows.stop] = length * segments.T
            self._density[rows, :8] = segments / area
            if number > 0:
                self._density[rows, 7 + number] = 1.0 / area
                eddy = circuit.iron_conductivity * circuit.lamination_thickness**2 * length / (12.0 * area)
                self._circulation[number - 1, rows] = -length / (8.0 * eddy)
        pinning = iron.pinning_field if iron.hysteresis else np.inf
        reversibility = iron.reversibility if iron.hysteresis else 1.0
        self._material = np.array(
            [iron.saturation_magnetisation, iron.anhysteretic_field, iron.interdomain_coupling, pinning, reversibility]
        )

    def block(self, first: int) -> Block:
        """Block of a bearing whose state begins at an index."""
        edges = first + np.concatenate([[0], np.cumsum(self._sizes)])
        return Block(*(slice(int(a), int(b)) for a, b in itertools.pairwise(edges)))

    def start(self, plant: Plant, state: NDArray[np.float64], block: Block) -> None:
        """Fluxes of the bias current, iron on its anhysteretic curve."""
        magnetised = plant.magnetostatics.solve(plant.bias_currents(), 0.0, 0.0)
        state[block.flux] = magnetised.flux
        state[block.circulating] = magnetised.circulating[: self._sizes[1]]
        state[block.delayed] = np.tile(magnetised.flux, self._sizes[2] // 8)
        saturation, a, alpha, *_ = self._material
        for n, density in enumerate(self._flux_density(state, block)):

            def excess(field: float, density: float = density) -> float:
                magnetisation = density / mu_0 - field
                return magnetisation - saturation * _langevin((field + alpha * magnetisation) / a)[0]

            state[block.field.start + n] = brentq(excess, -1e4, 1e4, xtol=1e-11, rtol=1e-14)

    def solved(
        self,
        state: NDArray[np.float64],
        block: Block,
        position: NDArray[np.float64],
        voltage: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Flux rates (8) and coil currents (4)."""
        in_gaps = (self._gap - DIRECTIONS @ position) * self._per_gap * state[block.flux]
        in_iron = self._drops @ state[block.flux.start : block.charge.start]
        return self._by_drop @ (in_gaps + in_iron) + self._by_voltage @ voltage

    def derivative(
        self,
        state: NDArray[np.float64],
        block: Block,
        position: NDArray[np.float64],
        voltage: NDArray[np.float64],
        rates: NDArray[np.float64],
    ) -> None:
        """Rates of a bearing's state into `rates`."""
        solved = self.solved(state, block, position, voltage)
        rates[block.flux], rates[block.charge] = solved[:8], solved[8:]
        rates[block.circulating] = self._circulation @ state[block.field]
        if len(self._lags):
            behind = state[block.flux] - state[block.delayed].reshape(-1, 8)
            rates[block.delayed] = self._lags * behind.ravel()
        if len(self._density):
            density_rate = self._density @ rates[block.flux.start : block.circulating.stop]
            rates[block.field] = self._slopes(state, block, density_rate) * density_rate

    def jacobian(
        self,
        state: NDArray[np.float64],
        block: Block,
        position: NDArray[np.float64],
        voltage: NDArray[np.float64],
        journal: NDArray[np.float64],
        coordinates: slice,
        jacobian: NDArray[np.float64],
    ) -> None:
        """Rows of a bearing's state, at which the rotor's coordinates have the displacement `journal`."""
        own = slice(block.flux.start, block.charge.start)
        drops = self._drops.copy()
        drops[:, :8] += np.diag((self._gap - DIRECTIONS @ position) * self._per_gap)
        by_position = -self._per_gap * (state[block.flux, np.newaxis] * DIRECTIONS) @ journal
        for rows, part in ((block.flux, self._by_drop[:8]), (block.charge, self._by_drop[8:])):
            jacobian[rows, own], jacobian[rows, coordinates] = part @ drops, part @ by_position
        jacobian[block.circulating, block.field] = self._circulation
        if len(self._lags):
            jacobian[block.delayed, block.flux] = self._lags[:, np.newaxis] * np.tile(
                np.eye(8), (len(self._lags) // 8, 1)
            )
            jacobian[block.delayed, block.delayed] = -np.diag(self._lags)
        if len(self._density):
            fluxes = slice(block.flux.start, block.circulating.stop)
            rates = np.concatenate(
                [self.solved(state, block, position, voltage)[:8], self._circulation @ state[block.field]]
            )
            slopes = self._slopes(state, block, self._density @ rates)
            jacobian[block.field] = (slopes[:, np.newaxis] * self._density) @ jacobian[fluxes]

    def _flux_density(self, state: NDArray[np.float64], block: Block) -> NDArray[np.float64]:
        return self._density @ state[block.flux.start : block.circulating.stop]

    def _slopes(
        self, state: NDArray[np.float64], block: Block, density_rate: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        return _differential_reluctivity(
            self._flux_density(state, block), state[block.field], density_rate, self._material
        )


@numba.njit(cache=True)
def _langevin(x: float) -> tuple[float, float]:
    """Function coth x - 1/x and its derivative."""
    if abs(x) < 0.05:
        z = x * x
        return (
            x * (1.0 / 3.0 - z * (1.0 / 45.0 - z * (2.0 / 945.0 - z / 4725.0))),
            1.0 / 3.0 - z * (1.0 / 15.0 - z * (2.0 / 189.0 - z / 675.0)),
        )
    coth = 1.0 / math.tanh(x)
    return coth - 1.0 / x, 1.0 - coth * coth + 1.0 / (x * x)


@numba.njit(cache=True)
def _differential_reluctivity(
    flux_density: NDArray[np.float64],
    field: NDArray[np.float64],
    density_rate: NDArray[np.float64],
    material: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Slopes dH/dB (m/H) after Jiles and Atherton; `material` holds M_s, a, alpha, k, c."""
    saturation, a, alpha, k, c = material
    slopes = np.empty_like(field)
    for n in range(len(field)):
        magnetisation = flux_density[n] / mu_0 - field[n]
        value, slope = _langevin((field[n] + alpha * magnetisation) / a)
        anhysteretic = saturation * value
        irreversible = 0.0
        if c < 1.0:
            walls = (magnetisation - c * anhysteretic) / (1.0 - c)  # M_irr
            delta = 1.0 if density_rate[n] >= 0.0 else -1.0
            irreversible = (1.0 - c) * max((anhysteretic - walls) / (delta * k), 0.0)
        susceptibility = irreversible + c * saturation / a * slope  # dM/dH_e
        slopes[n] = (1.0 - alpha * susceptibility) / (mu_0 * (1.0 + (1.0 - alpha) * susceptibility))
    return slopes
