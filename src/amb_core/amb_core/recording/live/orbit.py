"""Orbits: the path of the rotor in the plane of each radial bearing, thinned so that its farthest points stay."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.loop.machine import Machine


@dataclass(frozen=True)
class Plane:
    """How the axes of a radial bearing give horizontal and vertical position.

    Attributes
    ----------
    bearing : str
        Name of the bearing.
    weights : ndarray, shape (axes, 2)
        Position of the rotor, horizontal and vertical, per position of each axis of the machine (-).
    clearance : float
        Radial position at which the rotor touches the backup bearing (m); infinite if not known.
    """

    bearing: str
    weights: NDArray[np.float64]
    clearance: float


def planes_of(machine: Machine) -> tuple[Plane, ...]:
    """The planes of the radial bearings of a machine: those with axes that span a plane across the shaft.

    Parameters
    ----------
    machine : Machine
        The machine.

    Returns
    -------
    tuple of Plane
        One for each such bearing, in the order of the machine.
    """
    planes = []
    for bearing in machine.bearings:
        across = np.array([axis.direction[:2] if axis.bearing == bearing.name else (0.0, 0.0) for axis in machine.axes])
        if np.linalg.matrix_rank(across) == 2:
            # least squares: axes need be neither horizontal and vertical nor two
            planes.append(Plane(bearing.name, np.linalg.pinv(across).T, bearing.clearance))
    return tuple(planes)


class OrbitPath:
    """The last points of the path in several planes.

    Of every few samples it keeps the one farthest from the mean of the points before.

    Parameters
    ----------
    planes : tuple of Plane
        The planes.
    stride : int
        Samples per point.
    kept : int
        Points kept.
    """

    def __init__(self, planes: tuple[Plane, ...], stride: int, kept: int) -> None:
        self.planes, self.count = planes, 0
        self._stride, self._kept = stride, kept
        self._weights = np.concatenate([plane.weights for plane in planes], axis=1) if planes else np.empty((0, 0))
        self._points = np.full((kept, len(planes), 2), np.nan)
        self._rest = np.empty((0, len(planes), 2))

    def add(self, position: NDArray[np.float64]) -> None:
        """Take in consecutive positions, shape (steps, axes) (m).

        Parameters
        ----------
        position : ndarray, shape (steps, axes)
            Positions (m).
        """
        if not self.planes:
            return
        path = np.concatenate([self._rest, (position @ self._weights).reshape(len(position), len(self.planes), 2)])
        whole = len(path) // self._stride * self._stride
        self._rest = path[whole:]
        groups = path[:whole].reshape(-1, self._stride, len(self.planes), 2)
        if not len(groups):
            return
        known = np.isfinite(self._points)
        centre = self._points.sum(axis=0, where=known) / np.maximum(known.sum(axis=0), 1)
        farthest = np.argmax(np.nan_to_num(((groups - centre) ** 2).sum(axis=3)), axis=1)
        points = np.take_along_axis(groups, farthest[:, None, :, None], axis=1)[:, 0][-self._kept :]
        self.count += len(groups)
        self._points[np.arange(self.count - len(points), self.count) % self._kept] = points

    def since(self, first: int) -> tuple[int, NDArray[np.float64]]:
        """Number of the first kept point from `first` onwards, and the points, shape (points, planes, 2) (m).

        Parameters
        ----------
        first : int
            Number of the first point wanted.

        Returns
        -------
        (int, ndarray), shape (points, planes, 2)
            Number of the first point, and the points (m).
        """
        first = max(first, self.count - self._kept, 0)
        return first, self._points[np.arange(first, max(first, self.count)) % self._kept]
