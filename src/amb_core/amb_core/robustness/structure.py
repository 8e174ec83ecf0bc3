"""What is uncertain besides the identification: a list of scalar perturbations around the closed loop.

Where each is applied, with the signals of `feedback`, u the currents and y the positions:

- actuators (complex): u becomes (1 + r delta) u. Gain and phase of amplifier and magnet.
- current gain (real): the same with a real delta, after the actuator.
- negative stiffness (real): adds r delta K y to the currents at the magnets, with K = -P(1)^-1, the current per
  position that holds the rotor at rest: a force k_s y is a current (k_s/k_i) y. Exact at rest; at high frequencies it
  includes the lag of the amplifier, which the identified model does not separate from the magnet.
- sensors (complex): y becomes (1 + r delta) y.
- bending modes (real): natural frequency at constant decay, and decay at constant frequency, of every lightly damped
  stable pair of poles; to first order in r.

One identified model does not determine how the plant changes with running speed. A range of speeds is covered by the
frequency range of each whirl mode (`bending_frequency`), or by a certificate of the model of each speed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from amb_core.ground.errors import RobustnessError
from amb_core.linear import Arrays, Complexes, LinearSystem
from amb_core.robustness.feedback import Feedback
from amb_core.robustness.mu import Block
from amb_core.robustness.settings import RobustnessSettings

HIDDEN = 1e-9  # share of the response at its peak, from which a mode belongs to the plant from currents to positions
LIGHTLY_DAMPED = 0.1  # damping ratio below which a stable pair of poles is taken as a bending mode


@dataclass(frozen=True, eq=False)
class UncertainLoop:
    """The loop as its perturbations see it.

    Attributes
    ----------
    system : LinearSystem
        From w to z with w = diag(delta) z, |delta| <= 1 for the sizes of the settings.
    blocks : tuple of Block
        The perturbations, those of bending modes last.
    into, out, direct : ndarray, shapes (m + p, s), (s, m + p), (s, s)
        For the s perturbations at signals: with H the closed loop of `feedback`, they see out H into + direct.
    """

    system: LinearSystem
    blocks: tuple[Block, ...]
    into: Arrays
    out: Arrays
    direct: Arrays


@dataclass(frozen=True, eq=False)
class Mode:
    """A pair of poles of the plant in companion form: how its coefficients act on the states.

    Attributes
    ----------
    pole : complex
        z, upper half plane.
    into_states : ndarray, shape (n, 1)
        Where a change of the coefficients acts.
    from_states : ndarray, shape (2, n)
        The two states that the coefficients multiply.
    """

    pole: complex
    into_states: Arrays
    from_states: Arrays

    def row(self, change: complex) -> Arrays:
        """The output of states that moves the pole by a change, to first order; shape (1, n)."""
        coefficients = np.array([[-2.0 * (self.pole.conjugate() * change).real, 2.0 * change.real]])
        return np.asarray(coefficients @ self.from_states)


def uncertain_loop(feedback: Feedback, settings: RobustnessSettings) -> UncertainLoop:
    """The perturbations of the settings around a loop; those of size 0 are left out.

    Raises
    ------
    RobustnessError
        If nothing is uncertain, or the plant has a pole at z = 1, so that no current holds the rotor.
    """
    m, p, r = feedback.inputs, feedback.outputs, settings
    modes = bending_modes(feedback.plant)
    rows, columns, names, sizes = _modes(modes, feedback.plant.sample_time, r)
    opened = feedback.opened(
        np.hstack([*columns, np.zeros((feedback.plant.order, 0))]),
        np.vstack([*rows, np.zeros((0, feedback.plant.order))]),
    )
    into, out, direct = _connections(m, p, len(sizes), np.asarray(-np.linalg.pinv(_static_gain(feedback.plant))))
    radius = np.concatenate(
        [np.full(m, r.actuator), np.full(m, r.current_gain), np.full(m, r.negative_stiffness), np.full(p, r.sensor),
         sizes]
    )  # fmt: skip
    blocks = [Block(f"actuator {number + 1}") for number in range(m)]
    blocks += [Block(f"current gain {number + 1}", True) for number in range(m)]
    blocks += [Block(f"negative stiffness {number + 1}", True) for number in range(m)]
    blocks += [Block(f"sensor {name}") for name in feedback.axes] + [Block(name, True) for name in names]
    kept = np.flatnonzero(radius > 0.0)
    if not len(kept):
        raise RobustnessError("no uncertainty is larger than 0; give at least one")
    scale = radius[kept, np.newaxis]
    system = LinearSystem(
        opened.a,
        opened.b @ into[:, kept],
        scale * (out @ opened.c)[kept],
        scale * (out @ opened.d @ into + direct)[np.ix_(kept, kept)],
        opened.sample_time,
    )
    at_signals = kept[kept < 3 * m + p]
    size = radius[at_signals, np.newaxis]
    return UncertainLoop(
        system,
        tuple(blocks[place] for place in kept),
        into[: m + p, at_signals],
        size * out[at_signals, : m + p],
        size * direct[np.ix_(at_signals, at_signals)],
    )


def _connections(m: int, p: int, extra: int, holding: Arrays) -> tuple[Arrays, Arrays, Arrays]:
    """Where perturbations enter the signals of the loop, where they leave, and what passes directly.

    In the order of actuators, current gains, negative stiffnesses (m each), sensors (p) and modes; `holding` is the
    current for a position at rest, shape (m, p).
    """
    total, eye_u, eye_y = 3 * m + p + extra, np.eye(m), np.eye(p)
    a, g, k, s, x = np.split(np.arange(total), np.cumsum([m, m, m, p]))
    into = np.zeros((m + p + extra, total))
    into[:m, a], into[:m, g], into[:m, k] = eye_u, eye_u, eye_u
    into[m : m + p, s], into[m + p :, x] = eye_y, np.eye(extra)
    out, direct = np.zeros((total, m + p + extra)), np.zeros((total, total))
    out[a, :m], out[g, :m] = eye_u, eye_u
    direct[np.ix_(a, np.concatenate([a, g, k]))] = -np.hstack([eye_u, eye_u, eye_u])
    direct[np.ix_(g, np.concatenate([g, k]))] = -np.hstack([eye_u, eye_u])
    out[k, m : m + p], direct[np.ix_(k, s)] = holding, -holding
    out[s, m : m + p], direct[np.ix_(s, s)] = eye_y, -eye_y
    out[x, m + p :] = np.eye(extra)
    return into, out, direct


def bending_modes(plant: LinearSystem) -> list[Mode]:
    """The lightly damped stable modes of a plant, without those that no current moves or no position shows.

    A minimal realisation lacks such a mode. It does not take part in the loop, and its perturbations would only spoil
    the bounds.
    """
    values, right = np.linalg.eig(plant.a)
    if np.linalg.cond(right) > 1e12:
        return []
    left = np.linalg.inv(right)
    modes = []
    for pole, v, w in zip(values, right.T, left, strict=True):
        rate = np.log(complex(pole)) if pole != 0.0 else -np.inf
        light = pole.imag > 0.0 and abs(pole) < 1.0 and -rate.real < LIGHTLY_DAMPED * abs(rate)
        if light and _is_seen(plant, complex(pole), v, w):
            modes.append(_companion(plant, complex(pole), v, w))
    return modes


def _is_seen(plant: LinearSystem, pole: complex, v: Complexes, w: Complexes) -> bool:
    """Whether a mode adds more to the response at its peak than rounding does."""
    own = float(np.linalg.norm(plant.c @ v) * np.linalg.norm(w @ plant.b)) / (1.0 - abs(pole))
    return own > HIDDEN * plant.gain(float(np.angle(pole)) / (2.0 * np.pi * plant.sample_time))


def _companion(plant: LinearSystem, pole: complex, v: Complexes, w: Complexes) -> Mode:
    """Coordinates of a mode: its displacement as the outputs see it most, and the same a sample later."""
    states, shape = np.vstack([w.real, w.imag]), np.column_stack([2.0 * v.real, -2.0 * v.imag])
    motion = np.array([[pole.real, -pole.imag], [pole.imag, pole.real]])
    seen = np.linalg.svd(plant.c @ shape)[2][:1]
    into = np.vstack([seen, seen @ motion])
    return Mode(pole, np.asarray(shape @ np.linalg.inv(into)[:, 1:]), np.asarray(into @ states))


def _modes(
    modes: list[Mode], sample_time: float, settings: RobustnessSettings
) -> tuple[list[Arrays], list[Arrays], list[str], Arrays]:
    rows, columns, names, sizes = [], [], [], []
    for number, mode in enumerate(modes, 1):
        rate = np.log(mode.pole)
        hertz = rate.imag / (2.0 * np.pi * sample_time)
        for what, size, change in (
            ("frequency", settings.bending_frequency, 1j * rate.imag * mode.pole),
            ("damping", settings.bending_damping, rate.real * mode.pole),
        ):
            rows.append(mode.row(complex(change)))
            columns.append(mode.into_states)
            names.append(f"{what} of bending mode {number} ({hertz:.1f} Hz)")
            sizes.append(size)
    return rows, columns, names, np.array(sizes)


def _static_gain(plant: LinearSystem) -> Arrays:
    if np.any(np.abs(plant.poles() - 1.0) < 1e-9):
        raise RobustnessError("the plant has a pole at z = 1: no constant current holds the rotor; detrend the data")
    return plant.response(np.array([0.0]))[0].real
