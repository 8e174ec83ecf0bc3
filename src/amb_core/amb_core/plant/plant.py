"""The plant: power amplifiers, magnetic circuit and rotor behind one call per controller sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import PlantError
from amb_core.ground.given_values import kind_of, number, numbers, whole_number
from amb_core.ground.parameters import given_set
from amb_core.plant.axial import Axial, unpack_axial
from amb_core.plant.internal_step import require_short_step
from amb_core.plant.iron import initial_iron
from amb_core.plant.kernel import records
from amb_core.plant.kernel.advance import advance
from amb_core.plant.kernel.axial import ROW_SIZE
from amb_core.plant.kernel.rotor import COORDINATE, INPUTS, place_journals
from amb_core.plant.machine import machine_of
from amb_core.plant.magnetostatics import Magnetostatics
from amb_core.plant.network import COILS, active_coils, build_network
from amb_core.plant.packing import pack
from amb_core.plant.parameters import PlantParameters
from amb_core.plant.rotor import rotor_mass, rotor_model
from amb_core.plant.sensing import Sensing, quantise
from amb_core.plant.snapshot import PlantSnapshot
from amb_core.plant.trace import Trace, row_size, unpack

MOST_TRACED = 1_000_000
"""Samples of one trace."""


class Plant:
    """A radial bearing with its amplifiers and a point mass, or two with a rotor; optionally a thrust bearing.

    Inputs are the control current references of all axes (A); the amplifiers add the bias current. Outputs are the
    measured rotor positions of all axes (m). `advance` integrates exactly one controller sample. The axes are x and y,
    with a rotor in two bearings those of bearing A and then of B; z follows with a thrust bearing.

    Parameters
    ----------
    parameters : PlantParameters, optional
        Parameters of the plant; the defaults if None.

    Attributes
    ----------
    parameters : PlantParameters
        Its parameters.
    machine : Machine
        Its axes and bearings.
    network : MagneticNetwork
        The magnetic circuit, the same in both radial bearings.
    magnetostatics : Magnetostatics
        The magnetic circuit at rest.
    rotor : RotorModel or None
        The rotor in two bearings; None for a point mass in one.
    bearings : int
        Number of radial bearings, 1 or 2.
    axial : Axial or None
        The thrust bearing and the rotor along its axis; None without.
    delevitated : bool
        Whether the rotor touched a backup bearing at the end of a sample, or where the currents change within it
        (`converters.computation_delay`), unless contact is part of the model.
    samples : int
        Controller samples since the reset.
    sample_time : float
        Controller sample time (s).

    Raises
    ------
    PlantError
        If the internal step is too long (`amb_core.plant.internal_step`), or a file of iron or rotor data is refused.
    """

    def __init__(self, parameters: PlantParameters | None = None) -> None:
        self.parameters = parameters = given_set(PlantParameters, "parameters", parameters)
        self.machine = machine_of(parameters)
        self.network = build_network(parameters)
        self.magnetostatics = Magnetostatics(parameters, self.network)
        self.rotor = None if parameters.rotor.model == "point_mass" else rotor_model(parameters)
        self.bearings = 1 if self.rotor is None else 2
        self.axial = Axial(parameters, rotor_mass(parameters, self.rotor)) if parameters.rotor.axial else None
        require_short_step(parameters, self.magnetostatics, self.rotor)
        self._arrays = pack(parameters, self.network, self.magnetostatics, self.rotor)
        self._steps = parameters.steps_per_sample
        self._current_resolution = parameters.converters.current_resolution
        self._late_steps = round(parameters.converters.computation_delay * self._steps)
        self._no_trace = np.empty((0, row_size(self.bearings, self._coordinates)))
        self._no_axial_trace = np.empty((0, ROW_SIZE))
        self._sensing = Sensing(parameters, 2 * self.bearings)
        self.sample_time = 1.0 / parameters.integration.sample_rate
        self._set_views()
        self.reset()

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a copy: it has its own arrays, so the views must refer to these."""
        self.__dict__.update(state)
        self._set_views()

    def _set_views(self) -> None:
        self._state = self._arrays.state[0]
        self._sensed = self._state["sensed"][: 2 * self.bearings]

    def reset(self) -> None:
        """Rotor at rest at its initial position, bias current in all coils with the fluxes of the steady state."""
        arrays, rotor = self._arrays, self.parameters.rotor
        x, y = rotor.initial_x, rotor.initial_y
        arrays.state[:] = np.zeros((), records.STATE)
        arrays.bearings[:] = np.zeros((), records.BEARING)
        arrays.bearings["position"] = x, y
        if self.rotor is None:
            self._sensed[:] = x, y
        else:
            arrays.modes[:INPUTS] = 0.0  # the rows of the state
            arrays.modes[COORDINATE] = self.rotor.coordinates_at(x, y)
            place_journals(arrays.bearings, arrays.modes)
            self._sensed[:] = self.rotor.sensors @ self.rotor.coordinates_at(x, y)
        for bearing in arrays.bearings:
            self._reset_circuit(bearing, x, y)

        self.delevitated = False
        self.samples = 0
        self._sensing.reset()
        axes = len(self.machine.axes)
        self._reference, self._next_reference = np.zeros(axes), np.zeros(axes)
        self._measured = self._sensing.measure(self._sensed) if self._sensing.real else self._sensed
        if self.axial is not None:
            self.axial.reset()

    def _reset_circuit(self, bearing: np.void, x: float, y: float) -> None:
        bias = self.bias_currents()
        magnetised = self.magnetostatics.solve(bias, x, y)
        bearing["flux"] = magnetised.flux
        if self.parameters.iron.saturation:
            bearing["iron"] = initial_iron(magnetised.flux_density, self.parameters.iron)
            bearing["ring"]["flux"] = magnetised.circulating
        amplifier = self._arrays.constants[0]["amplifier"]
        period, shift = amplifier["period"], amplifier["carrier_shift"]
        # A coil with a later carrier still has a part of the switching period left that ends at its first update.
        gone = period - shift * np.arange(COILS) if shift else np.full(COILS, period)
        bearing["current_sum"] = bias * gone
        bearing["current_start"] = bias
        bearing["duty"] = 0.5

    @property
    def position(self) -> tuple[float, ...]:
        """Measured rotor position of each axis (m)."""
        radial = tuple(self._measured.tolist())
        return radial if self.axial is None else (*radial, self.axial.measured)

    @property
    def sensed(self) -> NDArray[np.float64]:
        """Position of each axis at its sensor (m), shape (axes,), before noise and converters; z as measured."""
        return np.array(self._sensed) if self.axial is None else np.append(self._sensed, self.axial.measured)

    @property
    def axes(self) -> tuple[str, ...]:
        """Radial axes along which the rotor can move: `x` and `y`, or `y` alone for a bearing with 1 DOF."""
        return ("x", "y") if self.parameters.magnetic_circuit.actuators == "two_axis" else ("y",)

    @property
    def contact(self) -> bool:
        """Whether a backup bearing pushed the rotor in the last internal step."""
        radial = bool(self._arrays.bearings["contact_force"].any())
        return radial or (self.axial is not None and self.axial.contact)

    def bias_currents(self) -> NDArray[np.float64]:
        """Bias current of every coil of a radial bearing (A), shape (4,); zero for coils without amplifier.

        Returns
        -------
        ndarray, shape (4,)
            Currents (A).
        """
        currents = np.zeros(COILS)
        currents[list(active_coils(self.parameters.magnetic_circuit))] = self.parameters.amplifier.bias_current
        return currents

    @property
    def coil_currents(self) -> NDArray[np.float64]:
        """Currents at the end of the last sample (A), shape (coils,): +x, +y, -x, -y of each bearing, then +z, -z."""
        currents = self._arrays.bearings["current"].flatten()
        return currents if self.axial is None else np.append(currents, self.axial.coil_currents)

    def advance(self, currents: Sequence[float] | NDArray[np.float64]) -> tuple[float, ...]:
        """Hold control current references (A) over one controller sample; return the new measured positions (m).

        Both have one value per axis of the machine.

        Once the rotor has touched the backup bearing at the end of a sample, `delevitated` is true and further calls
        are refused, unless contact is part of the model.

        Parameters
        ----------
        currents : sequence of float or ndarray, shape (axes,)
            Control current references (A).

        Returns
        -------
        tuple of float
            Measured positions of all axes (m).

        Raises
        ------
        PlantError
            If the rotor has delevitated, the number of references is wrong, or a reference or a state is not finite.
        """
        self._advance(currents, self._no_trace, self._no_axial_trace)
        return self.position

    def trace(self, currents: Sequence[float] | NDArray[np.float64], samples: int = 1) -> Trace:
        """Like `samples` calls of `advance` with the same references, returning every internal step.

        Parameters
        ----------
        currents : sequence of float or ndarray, shape (axes,)
            Control current references (A).
        samples : int, optional
            Number of controller samples.

        Returns
        -------
        Trace
            Variables at the start of every internal step.

        Raises
        ------
        PlantError
            As `advance`, or if `samples` is no whole number from 1.
        """
        samples = whole_number("samples", samples, PlantError)
        if not 1 <= samples <= MOST_TRACED:
            raise PlantError(f"samples = {samples} is not allowed; allowed: 1 to {MOST_TRACED}")
        rows = np.empty((samples * self._steps, self._no_trace.shape[1]))
        axial_rows = np.empty((0 if self.axial is None else len(rows), ROW_SIZE))
        for sample in range(samples):
            part = slice(sample * self._steps, (sample + 1) * self._steps)
            self._advance(currents, rows[part], axial_rows[part])
        trace = unpack(rows, self.bearings, self._coordinates, self.parameters.integration.internal_step)
        return trace if self.axial is None else replace(trace, axial=unpack_axial(axial_rows))

    def snapshot(self) -> PlantSnapshot:
        """Currents, flux densities and forces at the end of the last internal step.

        Returns
        -------
        PlantSnapshot
            Copies of these variables for every bearing.
        """
        bearings = self._arrays.bearings
        position, contact_force = bearings["position"].copy(), bearings["contact_force"].copy()
        currents = bearings["current"] if self._state["started"] else [self.bias_currents()]
        flux_density = bearings["flux"] / self.network.pole_area
        return PlantSnapshot(
            coil_current=np.array(np.broadcast_to(currents, (self.bearings, COILS))),
            flux_density=flux_density,
            force=self.magnetostatics.force(flux_density * self.network.pole_area),
            contact_force=contact_force,
            position=position,
            contact=contact_force.any(axis=1)
            | (np.hypot(position[:, 0], position[:, 1]) >= self.parameters.rotor.backup_bearing_radius),
            axial=None if self.axial is None else self.axial.snapshot(),
        )

    def journals(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Position (m) and velocity (m/s), shape (bearings, 2), and whether its backup bearing pushes each journal.

        Returns
        -------
        tuple of ndarray, shapes (bearings, 2), (bearings, 2), (bearings,)
            Position (m), velocity (m/s), and whether it is pushed.
        """
        bearings = self._arrays.bearings
        pushed: NDArray[np.bool_] = np.any(bearings["contact_force"], axis=1)
        return bearings["position"].copy(), bearings["velocity"].copy(), pushed

    def iron_state(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Flux density (T) and field (A/m) of nonlinear iron, each of shape (bearings, 24).

        Elements are the 8 poles, then the segments of the back iron, then those of the journal; no bearings for linear
        iron.

        Returns
        -------
        tuple of ndarray, shape (bearings, 24)
            Flux density (T) and field (A/m).
        """
        bearings = self._arrays.bearings if self.parameters.iron.saturation else self._arrays.bearings[:0]
        return bearings["iron"]["flux_density"].copy(), bearings["iron"]["field"].copy()

    def static_flux(self, coil_currents: NDArray[np.float64], x: float, y: float) -> NDArray[np.float64]:
        """Pole fluxes (Wb), shape (8,), of constant coil currents (A), shape (4,), at a rotor position (m).

        Parameters
        ----------
        coil_currents : ndarray, shape (4,)
            Coil currents (A).
        x, y : float
            Rotor position (m).

        Returns
        -------
        ndarray, shape (8,)
            Pole fluxes (Wb).

        Raises
        ------
        PlantError
            If a current is not finite, or the position is not finite or not inside the air gap.
        """
        gap = self.parameters.magnetic_circuit.air_gap
        coil_currents = numbers("coil currents", coil_currents, PlantError)
        if coil_currents.shape != (COILS,):
            raise PlantError(f"coil currents of shape {coil_currents.shape} are not allowed; allowed: ({COILS},)")
        x, y = number("x", x, PlantError), number("y", y, PlantError)
        if not np.isfinite(coil_currents).all():
            raise PlantError(f"coil currents {np.asarray(coil_currents).tolist()} A are not finite")
        if not x**2 + y**2 < gap**2:
            raise PlantError(f"rotor position {x} m, {y} m is not inside the air gap; allowed: less than {gap:g} m")
        return self.magnetostatics.solve(coil_currents, x, y).flux

    @property
    def _coordinates(self) -> int:
        return 0 if self.rotor is None else self.rotor.n

    def _advance(
        self,
        currents: Sequence[float] | NDArray[np.float64],
        rows: NDArray[np.float64],
        axial_rows: NDArray[np.float64],
    ) -> None:
        if self.delevitated:
            raise PlantError(f"the rotor delevitated at sample {self.samples}; reset the plant")
        before, now = self._reference, self._next_reference
        try:
            count, finite = len(currents), all(map(isfinite, currents))
        except (TypeError, OverflowError):
            raise PlantError(
                f"control current references: {kind_of(currents)} is not allowed; allowed: {len(now)} numbers (A), "
                f"{', '.join(self.machine.axis_names)}"
            ) from None
        if count != len(now):
            names = self.machine.axis_names
            raise PlantError(f"{count} control current references; allowed: {len(names)}, {', '.join(names)}")
        if not finite:
            raise PlantError(
                f"control current references {', '.join(f'{current:g}' for current in currents)} A not finite at "
                f"sample {self.samples + 1}, {(self.samples + 1) * self.sample_time:.6f} s"
            )
        now[:] = currents
        if self._current_resolution > 0.0:
            now[:] = quantise(now, self._current_resolution)
        late = self._late_steps
        status = advance(*self._arrays, before, late, rows[:late]) if late > 0 else records.OK
        if status in (records.OK, records.DELEVITATED) and late < self._steps:
            status = _joined(
                status, advance(*self._arrays, now, self._steps - late, rows[late:] if len(rows) else rows)
            )
        axial_status = records.OK if self.axial is None else self._advance_axial(self.axial, before, now, axial_rows)
        self._reference, self._next_reference = now, before
        self.samples += 1
        if status != records.OK:
            self._stop(status)
        elif axial_status != records.OK:
            self._stop_axial(axial_status)
        self._measured = self._sensing.measure(self._sensed) if self._sensing.real else self._sensed

    def _advance_axial(
        self, axial: Axial, before: NDArray[np.float64], now: NDArray[np.float64], rows: NDArray[np.float64]
    ) -> int:
        """Move the rotor along its axis over a sample, the new control current reference late as in the other axes."""
        late, status = self._late_steps, records.OK
        if late > 0:
            status = axial.advance(before[-1], late, rows[:late])
        if status in (records.OK, records.DELEVITATED) and late < self._steps:
            status = _joined(status, axial.advance(now[-1], self._steps - late, rows[late:] if len(rows) else rows))
        axial.measure()
        return status

    def _stop(self, status: int) -> None:
        bearings = self._arrays.bearings
        rotor = [bearings[name] for name in ("position", "velocity", "acceleration")]
        names = {"flux": bearings["flux"], "rotor": np.stack(rotor)}
        bad = [name for name, part in names.items() if not np.isfinite(part).all()]
        self._end(status, "a journal reached the poles", ", ".join(bad))

    def _stop_axial(self, status: int) -> None:
        self._end(status, "the disc reached the poles of the thrust bearing", "thrust bearing")

    def _end(self, status: int, closed: str, bad: str) -> None:
        """Note a delevitation; raise for a closed gap, as `closed` says it, or a state that is not finite in `bad`."""
        if status == records.DELEVITATED:
            self.delevitated = True
            return
        when = f"at sample {self.samples}, {self.samples * self.sample_time:.6f} s"
        if status == records.GAP_CLOSED:
            raise PlantError(
                f"{closed} {when}, through a backup bearing of stiffness "
                f"{self.parameters.backup_bearing.stiffness:g} N/m; reset the plant"
            )
        raise PlantError(f"state not finite ({bad}) {when}; reset the plant")


def _joined(first: int, second: int) -> int:
    """Status of a sample in two parts: a rotor that touched at the end of the first part and recedes has touched."""
    return first if second == records.OK else second
