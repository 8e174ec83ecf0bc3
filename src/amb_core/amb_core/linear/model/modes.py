"""The modes of a linear discrete-time model: natural frequency, damping ratio, whirl direction and mode shape.

A pole z of the model has the rate s = ln(z) / T, the natural frequency |s| and the damping ratio -Re(s) / |s|; its
mode shape is C v with the eigenvector v: the complex displacements at the sensors. The part of the response that
belongs to the mode, C v w B / (z - z_i), has at its peak the gain |C v w B| / |1 - |z_i||. Modes of the machine have a
large gain of the displacement, or of the velocity, |s| times as much: soft modes stand out in the one, fast ones with
little damping in the other. States that hardly matter are small in both.

Of a machine with negative stiffness the plant alone has real poles instead of rigid body modes; these oscillate in the
loop. Bending modes are in both.

Sources: Schweitzer, Maslen (eds.), "Magnetic Bearings", Springer 2009, ch. 7 (rigid modes, nutation and precession) and
10 (bending); Genta, "Dynamics of Rotating Systems", Springer 2005, ch. 3 and 4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from amb_core.linear import LinearSystem, rates_of
from amb_core.linear.model.mode import Mode
from amb_core.linear.model.mode_kinds import with_kinds
from amb_core.linear.model.whirl import ellipticity, sensor_planes, whirl_of

LEAST_GAIN = 0.01
"""Peak gain of a mode, over the largest of all modes, below which a table of modes leaves it out."""
_SAME_RATE = 1e-4


@dataclass(frozen=True, eq=False)
class Modes:
    """The modes of a model, slowest first.

    Attributes
    ----------
    modes : tuple of Mode
        Those slower than half the sample rate; faster poles have no oscillation in the samples.
    output_names : tuple of str
        Names of the outputs, in the order of the shapes.
    poles : ndarray, shape (n,)
        All poles of the model (-), also those that have no mode or whose mode is not selected.
    """

    modes: tuple[Mode, ...]
    output_names: tuple[str, ...]
    poles: NDArray[np.complex128]

    @property
    def stable(self) -> bool:
        """Whether all poles of the model are inside the unit circle."""
        return bool(np.all(np.abs(self.poles) < 1.0))

    @property
    def unstable_without_mode(self) -> int:
        """Number of unstable poles as fast as half the sample rate or faster, which have no mode."""
        return int(np.sum((np.abs(self.poles) >= 1.0) & ~_has_mode(rates_of(self.poles, 1.0), 1.0)))

    def of_kind(self, *kinds: str) -> tuple[Mode, ...]:
        """The modes of these kinds."""
        return tuple(mode for mode in self.modes if mode.kind in kinds)

    def selected(self, least_gain: float = LEAST_GAIN) -> Modes:
        """Only those with at least this relative gain."""
        return replace(self, modes=tuple(mode for mode in self.modes if mode.gain >= least_gain))

    def to_json(self) -> list[dict[str, Any]]:
        """A mapping per mode; `shape` has magnitude and phase (degrees) by output, `orbit` the ratio of the half axes
        by sensor plane, positive for a forward orbit.
        """
        return [self._entry(mode) for mode in self.modes]

    def _entry(self, mode: Mode) -> dict[str, Any]:
        return {
            "kind": mode.kind,
            "natural_hz": mode.natural_hz,
            "damped_hz": mode.damped_hz,
            "damping_ratio": mode.damping_ratio,
            "stable": mode.stable,
            "whirl": mode.whirl,
            "gain": mode.gain,
            "shape": {
                name: [abs(value), math.degrees(np.angle(value))]
                for name, value in zip(self.output_names, mode.shape.tolist(), strict=True)
            },
            "orbit": {plane.name: ellipticity(mode.shape, plane) for plane in sensor_planes(self.output_names)}
            if mode.oscillates
            else {},
        }


def modes_of(system: LinearSystem) -> Modes:
    """All modes of a discrete-time model.

    Parameters
    ----------
    system : LinearSystem
        Discrete, from currents or references to positions: `linearize(plant, controller).discrete` or `.closed_loop`,
        an identified model, or its `close_loop`.
    """
    poles, left, right = linalg.eig(system.a, left=True, right=True)
    names = system.output_names
    planes = sensor_planes(names)
    rates = rates_of(poles, system.sample_time)
    slow = np.flatnonzero(_has_mode(rates, system.sample_time) & (rates.imag >= 0.0))
    modes = []
    for group in _groups(rates, slow):
        shapes, drives = _separated(system.c @ right[:, group], _dual(left[:, group], right[:, group]) @ system.b)
        for number, shape, drive in zip(group, shapes.T, drives, strict=True):
            largest = shape[np.argmax(np.abs(shape))]
            gain = np.linalg.norm(shape) * np.linalg.norm(drive) / max(abs(1.0 - abs(poles[number])), 1e-300)
            mode = Mode(complex(rates[number]), shape / largest if largest else shape, float(gain), "none")
            modes.append(replace(mode, whirl=whirl_of(mode.shape, planes)) if mode.oscillates else mode)
    ordered = tuple(sorted(_relative(modes), key=lambda mode: abs(mode.rate)))
    return Modes(with_kinds(ordered, planes, LEAST_GAIN), names, poles)


def _has_mode(rates: NDArray[np.complex128], sample_time: float) -> NDArray[np.bool_]:
    """Whether rates (1/s) are slower than half the sample rate."""
    return np.asarray(np.abs(rates) < math.pi / sample_time)


def _relative(modes: list[Mode]) -> list[Mode]:
    """The modes with the larger of their gains of displacement and velocity, each over the largest of all modes."""
    gains = np.array([[mode.gain, mode.gain * abs(mode.rate)] for mode in modes]).reshape(len(modes), 2)
    largest = gains.max(axis=0, initial=np.finfo(np.float64).tiny)
    return [replace(mode, gain=float(gain)) for mode, gain in zip(modes, (gains / largest).max(axis=1), strict=True)]


def _groups(rates: NDArray[np.complex128], slow: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """The numbers in `slow`, those of the same rate together."""
    groups, left = [], list(slow)
    while left:
        same = [n for n in left if abs(rates[n] - rates[left[0]]) <= _SAME_RATE * abs(rates[left[0]])]
        groups.append(np.array(same))
        left = [n for n in left if n not in same]
    return groups


def _dual(left: NDArray[np.complex128], right: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Left eigenvectors as rows, scaled so that their product with the right ones is the identity."""
    return np.asarray(np.linalg.pinv(left.conj().T @ right) @ left.conj().T)


def _separated(
    shapes: NDArray[np.complex128], drives: NDArray[np.complex128]
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Shapes (columns) and drives (rows) of modes of one rate, each shape the only one that moves one of the outputs.

    Any mixture of modes of one rate is a mode again, so the eigenvectors are an accident; a rotor alike along x and y
    at standstill gets its modes along x and along y.
    """
    if shapes.shape[1] == 1:
        return shapes, drives
    _, triangle, pivots = linalg.qr(shapes.T, pivoting=True, mode="economic")
    sizes = np.abs(np.diag(triangle))
    if len(sizes) < shapes.shape[1] or sizes[-1] < 1e-6 * sizes[0]:
        return shapes, drives  # fewer shapes than modes: they are not separable
    square = shapes[np.sort(pivots[: shapes.shape[1]])]
    return shapes @ np.linalg.inv(square), square @ drives
