"""The plants of the benchmark's sets `rotor4` and `siso`.

`rotor4` is a rigid rotor that turns at 12 000 rpm in two bearings of the paper's table 1. With x, y the motion of its
centre and alpha, beta the slopes of its axis in the planes xz and yz,

    m x'' = f_x,  m y'' = f_y,  I_t alpha'' + Omega I_p beta' = t_alpha,  I_t beta'' - Omega I_p alpha' = t_beta,

with magnetic forces k_s q + k_i i at each bearing and axis. Currents follow their references with a lag of first order.
States: 4 positions, 4 velocities, 4 currents: order 12, with four unstable poles. Axes are x_a, y_a, x_b, y_b.

`siso` is one axis of that bearing for half the rotor, with a bending mode: order 5, one unstable pole.

Source of the rotor's equations: G. Schweitzer and E. H. Maslen (eds.), Magnetic Bearings, Springer, 2009, chapter 7.
"""

from __future__ import annotations

import functools

import numpy as np
from scipy.signal import cont2discrete

from tests.benchmarks.ident.linear_loop import SAMPLE_TIME, Arrays, LinearLoop

_CURRENT_GAIN = 66.0  # N/A
_STIFFNESS = 3.30e5  # N/m, magnitude of the negative stiffness
_PROPORTIONAL, _DERIVATIVE = 20_000.0, 38.0  # A/m, A s/m

_MASS = 12.5  # kg
_TRANSVERSE_INERTIA, _POLAR_INERTIA = 0.30, 0.06  # kg m^2
_SPEED = 2.0 * np.pi * 200.0  # rad/s
_BEARINGS = (0.12, -0.15)  # m, axial position of the magnets from the centre of mass
_SENSORS = (0.14, -0.17)  # m
_BANDWIDTHS = (1_500.0, 2_000.0, 1_700.0, 1_900.0)  # Hz, of the currents

_HALF_MASS = 6.25  # kg
_MODE = (900.0, 0.005, 0.2)  # Hz, damping ratio, acceleration by a force relative to the rigid rotor's


@functools.cache
def rotor4() -> LinearLoop:
    """The turning rotor in two bearings."""
    at_magnets, at_sensors = _lever_arms(_BEARINGS), _lever_arms(_SENSORS)
    inverse = np.diag([1.0 / _MASS, 1.0 / _MASS, 1.0 / _TRANSVERSE_INERTIA, 1.0 / _TRANSVERSE_INERTIA])
    gyroscopic = np.zeros((4, 4))
    gyroscopic[2, 3], gyroscopic[3, 2] = -_SPEED * _POLAR_INERTIA, _SPEED * _POLAR_INERTIA
    by_force = inverse @ at_magnets.T
    a, b, c = np.zeros((12, 12)), np.zeros((12, 8)), np.zeros((4, 12))
    a[:4, 4:8] = np.eye(4)
    a[4:8, :4] = by_force @ (_STIFFNESS * at_magnets)
    a[4:8, 4:8] = inverse @ gyroscopic
    a[4:8, 8:] = by_force * _CURRENT_GAIN
    rates = 2.0 * np.pi * np.array(_BANDWIDTHS)
    a[8:, 8:], b[8:, :4] = -np.diag(rates), np.diag(rates)
    b[4:8, 4:] = by_force
    c[:, :4] = at_sensors
    return _loop(a, b, c, 4)


@functools.cache
def siso() -> LinearLoop:
    """One axis of a bearing."""
    frequency, damping, gain = _MODE
    angular, rate = 2.0 * np.pi * frequency, 2.0 * np.pi * _BANDWIDTHS[0]
    a, b = np.zeros((5, 5)), np.zeros((5, 2))
    a[0, 1] = a[2, 3] = 1.0
    a[1, [0, 4]] = np.array([_STIFFNESS, _CURRENT_GAIN]) / _HALF_MASS
    a[3, [2, 3, 4]] = -(angular**2), -2.0 * damping * angular, gain * _CURRENT_GAIN / _HALF_MASS
    a[4, 4], b[4, 0] = -rate, rate
    b[[1, 3], 1] = 1.0 / _HALF_MASS, gain / _HALF_MASS
    return _loop(a, b, np.array([[1.0, 0.0, 1.0, 0.0, 0.0]]), 1)


def _loop(a: Arrays, b: Arrays, c: Arrays, axes: int) -> LinearLoop:
    """The loop of a plant in continuous time, whose first inputs are the currents."""
    a, b, *_ = cont2discrete((a, b, c, np.zeros((axes, b.shape[1]))), SAMPLE_TIME)
    gains = np.full(axes, _PROPORTIONAL), np.full(axes, _DERIVATIVE)
    return LinearLoop(a, b[:, :axes], c, b[:, axes:], *gains)


def _lever_arms(places: tuple[float, float]) -> Arrays:
    """Motion along x_a, y_a, x_b, y_b at two axial positions, from x, y, alpha, beta."""
    return np.vstack([np.hstack([np.eye(2), place * np.eye(2)]) for place in places])
