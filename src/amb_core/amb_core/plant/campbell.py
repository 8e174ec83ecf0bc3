"""Campbell diagram: natural frequencies of the rotor in its loop over the running speed, and the critical speeds.

A critical speed is where the damped natural frequency of a mode in the loop equals the running speed (1x): there an
unbalance excites it, forward modes in any bearing, backward ones where the bearing is not the same along x and y. Its
amplification factor is about 1 / (2 zeta); API 617 counts modes with less than 2.5 as critically damped.

Modes are followed from speed to speed by their rates and shapes. Where one moves too far for that, speeds are added in
between; where it still does and a crossing of the 1x line can be missing, `Campbell.gaps` names the interval.

Sources: Schweitzer, Maslen (eds.), "Magnetic Bearings", Springer 2009, ch. 7 and 10; Genta, "Dynamics of Rotating
Systems", Springer 2005, ch. 3; API RP 684 (amplification factor).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import PlantError
from amb_core.ground.parameters import flatten, validate
from amb_core.ground.progress import Progress
from amb_core.linear.model.modes import LEAST_GAIN, Mode, Modes, modes_of
from amb_core.loop.control import ControllerParameters
from amb_core.plant.linearise import linearize
from amb_core.plant.parameters import PlantParameters
from amb_core.plant.plant import Plant

LEAST_AMPLIFICATION = 2.5
_FARTHEST = 0.3  # relative distance of the rates of one branch at neighbouring speeds
_HALVINGS = 5  # of the distance of neighbouring speeds, at most, until all modes are followed
_FADING = 0.5 * LEAST_GAIN  # gain down to which a mode that is no longer selected is still the same mode
_RPM = 60.0


@dataclass(frozen=True, eq=False)
class Branch:
    """One mode over the running speed.

    Attributes
    ----------
    speed : ndarray, shape (n,)
        Running speeds at which it oscillates (Hz).
    modes : tuple of Mode
        The mode at each.
    """

    speed: NDArray[np.float64]
    modes: tuple[Mode, ...]

    @property
    def damped_hz(self) -> NDArray[np.float64]:
        """Damped natural frequency at each speed (Hz)."""
        return np.array([mode.damped_hz for mode in self.modes])


@dataclass(frozen=True)
class CriticalSpeed:
    """A running speed (Hz) at which a mode of the loop has this frequency, and the mode there."""

    speed: float
    kind: str
    whirl: str
    damping_ratio: float

    @property
    def rpm(self) -> float:
        """The speed in revolutions per minute."""
        return _RPM * self.speed

    @property
    def amplification(self) -> float:
        """Amplification factor 1 / (2 zeta); infinite without damping."""
        return 0.5 / self.damping_ratio if self.damping_ratio > 0.0 else np.inf

    @property
    def critically_damped(self) -> bool:
        """Whether the mode has so much damping that it counts as no critical speed."""
        return 0.0 < self.amplification < LEAST_AMPLIFICATION


@dataclass(frozen=True, eq=False)
class Campbell:
    """Modes of plant and closed loop over the running speed.

    Attributes
    ----------
    speed : ndarray, shape (s,)
        Running speeds, ascending (Hz).
    plant, closed_loop : tuple of Modes
        The modes at each speed: of the plant alone, and of its loop.
    """

    speed: NDArray[np.float64]
    plant: tuple[Modes, ...]
    closed_loop: tuple[Modes, ...]

    @property
    def branches(self) -> tuple[Branch, ...]:
        """The oscillating modes of the loop, each followed over the speed."""
        return _branches(self.speed, [_oscillating(modes) for modes in self.closed_loop])

    @property
    def open_branches(self) -> tuple[Branch, ...]:
        """The bending modes of the plant alone. Its rigid modes have no frequency: negative stiffness."""
        return _branches(self.speed, [modes.of_kind("bending") for modes in self.plant])

    @property
    def stable(self) -> bool:
        """Whether the loop is stable at all speeds."""
        return all(modes.stable for modes in self.closed_loop)

    @property
    def critical_speeds(self) -> tuple[CriticalSpeed, ...]:
        """Where branches of the loop cross the running speed, interpolated between the computed speeds; ascending."""
        crossings = [critical for branch in self.branches for critical in _crossings(branch)]
        return tuple(sorted(crossings, key=lambda critical: critical.speed))

    @property
    def gaps(self) -> tuple[tuple[float, float], ...]:
        """Neighbouring speeds (Hz) between which a mode that is not followed can have crossed the running speed."""
        speeds, loops = pairwise(self.speed.tolist()), pairwise(self.closed_loop)
        return tuple(pair for pair, modes in zip(speeds, loops, strict=True) if _crossing_missed(pair, modes))

    @property
    def remarks(self) -> tuple[str, ...]:
        """What the critical speeds leave open."""
        return tuple(
            f"between {_RPM * left:.0f} and {_RPM * right:.0f} rpm the modes cannot be followed: take more speeds"
            for left, right in self.gaps
        )

    def to_json(self) -> dict[str, Any]:
        """Critical speeds, and the modes of plant and loop at every speed."""
        return {
            "stable": self.stable,
            "not_followed_rpm": [[_RPM * left, _RPM * right] for left, right in self.gaps],
            "critical_speeds": [
                {
                    "rpm": critical.rpm,
                    "hz": critical.speed,
                    "kind": critical.kind,
                    "whirl": critical.whirl,
                    "damping_ratio": critical.damping_ratio,
                    "critically_damped": critical.critically_damped,
                }
                for critical in self.critical_speeds
            ],
            "speeds": [
                {
                    "rpm": _RPM * speed,
                    "closed_loop": closed_loop.selected().to_json(),
                    "plant": plant.selected().to_json(),
                }
                for speed, closed_loop, plant in zip(self.speed.tolist(), self.closed_loop, self.plant, strict=True)
            ],
        }


def campbell(
    parameters: PlantParameters,
    controller: ControllerParameters,
    speeds: Iterable[float],
    progress: Progress | None = None,
) -> Campbell:
    """Compute the modes of a machine at several running speeds, and between these where modes move too far.

    Parameters
    ----------
    parameters : PlantParameters
        The plant; its own running speed has no influence.
    controller : ControllerParameters
        The controller of the loop.
    speeds : iterable of float
        Running speeds (Hz), ascending. Where a mode cannot be followed from one to the next, up to 31 are added.
    progress : callable, optional
        Called after each of these speeds, see `amb_core.ground.progress.Progress`.

    Raises
    ------
    PlantError
        If the speeds do not ascend, or the controller cannot hold the rotor.
    ParameterError
        If a speed is out of the range of `rotor.running_speed`.
    """
    speed = np.array(list(speeds), dtype=np.float64)
    if not len(speed) or np.any(np.diff(speed) <= 0.0):
        raise PlantError(f"running speeds {speed.tolist()} Hz are not allowed; needed: at least one, ascending")
    values = flatten(parameters.model_dump())

    def modes_at(running_speed: float) -> _PlantAndLoop:
        changed = validate(PlantParameters, values | {"rotor.running_speed": running_speed})
        model = linearize(Plant(changed), controller)
        return modes_of(model.discrete), modes_of(model.closed_loop)

    at_speed: dict[float, _PlantAndLoop] = {}
    for number, value in enumerate(speed.tolist()):
        at_speed[value] = modes_at(value)
        if progress is not None:
            progress("modes", number + 1, len(speed))
    for left, right in pairwise(speed.tolist()):
        _add_between(left, right, _HALVINGS, at_speed, modes_at)
    plants, loops = zip(*(at_speed[value] for value in sorted(at_speed)), strict=True)
    return Campbell(np.array(sorted(at_speed)), plants, loops)


_PlantAndLoop = tuple[Modes, Modes]


def _add_between(
    left: float,
    right: float,
    halvings: int,
    at_speed: dict[float, _PlantAndLoop],
    modes_at: Callable[[float], _PlantAndLoop],
) -> None:
    """Halve an interval of speeds until all modes of the loop are followed through it, or as often as allowed."""
    if not halvings or not any(_not_followed(at_speed[left][1], at_speed[right][1])):
        return
    middle = 0.5 * (left + right)
    at_speed[middle] = modes_at(middle)
    for ends in ((left, middle), (middle, right)):
        _add_between(*ends, halvings - 1, at_speed, modes_at)


def _crossing_missed(speeds: tuple[float, float], loops: tuple[Modes, Modes]) -> bool:
    """Whether, of the modes that are not followed between two speeds, more are above the 1x line at one of them."""
    lost = zip(speeds, _not_followed(*loops), strict=True)
    before, after = (sum(mode.damped_hz > speed for mode in modes) for speed, modes in lost)
    return before != after


def _not_followed(left: Modes, right: Modes) -> tuple[list[Mode], list[Mode]]:
    """The oscillating modes of neighbouring speeds that no branch has on both sides, without those that fade."""
    before, after = _oscillating(left), _oscillating(right)
    pairs = _closest(before, after)
    ends = [mode for number, mode in enumerate(before) if number not in {row for _, row in pairs}]
    starts = [mode for number, mode in enumerate(after) if number not in {column for column, _ in pairs}]
    return _without_partner(ends, _faint(right)), _without_partner(starts, _faint(left))


def _without_partner(modes: list[Mode], others: tuple[Mode, ...]) -> list[Mode]:
    partnered = {row for _, row in _closest(modes, others)}
    return [mode for number, mode in enumerate(modes) if number not in partnered]


def _oscillating(modes: Modes) -> tuple[Mode, ...]:
    return tuple(mode for mode in modes.selected().modes if mode.oscillates)


def _faint(modes: Modes) -> tuple[Mode, ...]:
    """Oscillating modes that are just not selected."""
    return tuple(mode for mode in modes.selected(_FADING).modes if mode.oscillates and mode.gain < LEAST_GAIN)


def _branches(speed: NDArray[np.float64], at_speed: list[tuple[Mode, ...]]) -> tuple[Branch, ...]:
    """Modes of neighbouring speeds belong to one branch if rates and shapes together are closest."""
    branches: list[list[tuple[float, Mode]]] = []
    open_ones: list[int] = []
    for value, modes in zip(speed.tolist(), at_speed, strict=True):
        ends = [branches[number][-1][1] for number in open_ones]
        following = dict(_closest(ends, modes))
        still_open = []
        for column, mode in enumerate(modes):
            row = following.get(column)
            if row is None:
                branches.append([(value, mode)])
                still_open.append(len(branches) - 1)
            else:
                branches[open_ones[row]].append((value, mode))
                still_open.append(open_ones[row])
        open_ones = still_open
    return tuple(
        Branch(np.array([value for value, _ in branch]), tuple(mode for _, mode in branch)) for branch in branches
    )


def _closest(ends: Sequence[Mode], modes: Sequence[Mode]) -> list[tuple[int, int]]:
    """Pairs of a mode and the end of a branch which it continues, as numbers."""
    from scipy.optimize import linear_sum_assignment  # takes a quarter of a second to import

    if not ends or not modes:
        return []
    rates = [np.array([mode.rate for mode in side]) for side in (ends, modes)]
    shapes = [np.array([mode.shape / np.linalg.norm(mode.shape) for mode in side]) for side in (ends, modes)]
    distance = np.abs(np.subtract.outer(*rates)) / np.abs(rates[0])[:, np.newaxis]
    unlike = 1.0 - np.abs(shapes[0].conj() @ shapes[1].T) ** 2
    rows, columns = linear_sum_assignment(distance + unlike)
    return [
        (int(column), int(row)) for row, column in zip(rows, columns, strict=True) if distance[row, column] <= _FARTHEST
    ]


def _crossings(branch: Branch) -> list[CriticalSpeed]:
    above = branch.damped_hz - branch.speed
    crossings = []
    for left in np.flatnonzero((above[:-1] > 0.0) != (above[1:] > 0.0)):
        share = above[left] / (above[left] - above[left + 1])
        near = branch.modes[left + round(float(share))]
        speed, damping = (
            float(values[left] + share * (values[left + 1] - values[left]))
            for values in (branch.speed, np.array([mode.damping_ratio for mode in branch.modes]))
        )
        crossings.append(CriticalSpeed(speed, near.kind, near.whirl, damping))
    return crossings
