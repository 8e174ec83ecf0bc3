"""Modes of a flexible rotor: the data that the plant needs, and their file.

The modes are those of the free rotor at standstill: no bearings (their force comes from the magnetic circuit) and no
speed. The rotor lies in axes x (horizontal), y (up) and z (along the shaft, bearing A at smaller z than B), and turns
from +x to +y. Its motion is q'' + (D + Omega G) q' + K q = forces, with one modal coordinate q per mode and D and K
diagonal, 2 zeta omega and omega^2.

A file is NumPy's `.npz` with the arrays of `ModalData` under their names (`description` may be left out), so any finite
element program or modal test can supply it, through `ModalData` or directly::

    numpy.savez(
        "rotor.npz",
        natural_frequencies=...,  # (n,) Hz; 0 for the four rigid body modes
        damping_ratios=...,       # (n,) -
        bearings=...,             # (4, n) 1/sqrt(kg)
        sensors=...,              # (4, n) 1/sqrt(kg)
        unbalance=...,            # (2, n) 1/sqrt(kg)
        weight=...,               # (n,) sqrt(kg)
        gyroscopic=...,           # (n, n) -
    )

With mode shapes in the columns of Phi, normalised to unit modal mass, and the finite element matrices: Phi^T M Phi = I,
weight = -Phi^T M u with u a unit displacement of all nodes along y, gyroscopic = Phi^T G Phi with Omega G the
gyroscopic matrix at the running speed Omega (rad/s). Shapes with another modal mass m are divided by sqrt(m).

Sources: Schweitzer, Maslen (eds.), "Magnetic Bearings", Springer 2009, ch. 10 and 12; Genta, "Dynamics of Rotating
Systems", Springer 2005, ch. 4.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import PlantError
from amb_core.ground.files.arrays import load_arrays
from amb_core.ground.files.package_files import located
from amb_core.ground.files.regular_files import shown

_SKEW_TOLERANCE = 1e-6
"""Largest symmetric part of the gyroscopic matrix, relative to its largest element; allows single precision files."""


@dataclass(frozen=True, eq=False)
class ModalData:
    """Modes of a free rotor, n of them, each of unit modal mass; arrays are read-only.

    Attributes
    ----------
    natural_frequencies : ndarray, shape (n,)
        Natural frequencies at standstill (Hz); 0 for rigid body modes.
    damping_ratios : ndarray, shape (n,)
        Damping ratios (-), 0 to 1; without effect for rigid body modes.
    bearings, sensors : ndarray, shape (4, n)
        Mode shapes at bearings A x, A y, B x, B y, and at their sensors (1/sqrt(kg)).
    unbalance : ndarray, shape (2, n)
        Mode shapes along x and y in the plane of the unbalance (1/sqrt(kg)).
    weight : ndarray, shape (n,)
        Modal force of a gravity of 1 m/s^2 along -y (sqrt(kg)).
    gyroscopic : ndarray, shape (n, n)
        Gyroscopic matrix per running speed in rad/s (-), skew.
    description : str
        The rotor and the source of the data.

    Raises
    ------
    PlantError
        If shapes do not fit together, a value is not finite or out of its range, the gyroscopic matrix is not skew, or
        the modes do not move the two journals independently along x and y.
    """

    natural_frequencies: NDArray[np.float64]
    damping_ratios: NDArray[np.float64]
    bearings: NDArray[np.float64]
    sensors: NDArray[np.float64]
    unbalance: NDArray[np.float64]
    weight: NDArray[np.float64]
    gyroscopic: NDArray[np.float64]
    description: str = ""

    def __post_init__(self) -> None:
        for name in _ARRAYS:
            given = np.asarray(getattr(self, name))
            if given.dtype.kind not in "fiu":
                raise PlantError(f"modal data: '{name}' holds {given.dtype} values; real numbers are needed")
            array = np.array(given, dtype=np.float64, order="C")
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        self._check()

    @property
    def modes(self) -> int:
        """Number of modes n."""
        return len(self.natural_frequencies)

    def static_loads(self, gravity: float) -> NDArray[np.float64]:
        """Forces that carry the rotor's weight at A x, A y, B x, B y (N), shape (4,), by a gravity along -y (m/s^2).

        Parameters
        ----------
        gravity : float
            Gravity along -y (m/s^2).

        Returns
        -------
        ndarray, shape (4,)
            Forces (N).
        """
        rigid = self.natural_frequencies == 0.0
        return np.linalg.lstsq(self.bearings[:, rigid].T, -gravity * self.weight[rigid], rcond=None)[0]

    def save(self, path: str | Path) -> None:
        """Write the file.

        Parameters
        ----------
        path : str or Path
            File to write, .npz.

        Raises
        ------
        PlantError
            If the file name does not end in .npz, or the file cannot be written.
        """
        path = Path(path)
        if path.suffix.lower() != ".npz":
            raise PlantError(f"modal data {path}: the file name must end in .npz")
        try:
            with path.open("wb") as file:
                np.savez_compressed(file, **{item.name: getattr(self, item.name) for item in fields(self)})
        except OSError as problem:
            raise PlantError(f"modal data {path}: cannot be written: {problem.strerror}") from None

    @classmethod
    def load(cls, path: str | Path) -> ModalData:
        """Read a file, named by a path or, in the shared folder of a package, by `package://PACKAGE/PATH`.

        Parameters
        ----------
        path : str or Path
            Path of the file, or `package://PACKAGE/PATH`.

        Returns
        -------
        ModalData
            Modes, weights and places of the rotor.

        Raises
        ------
        PlantError
            If the file cannot be read, lacks an array, has an unknown one, or its arrays are refused (see `ModalData`);
            the message names the file.
        """
        content = _read(path)
        missing = [name for name in _ARRAYS if name not in content]
        if missing:
            raise PlantError(f"modal data {path}: lacks {', '.join(missing)}; found {', '.join(content) or 'nothing'}")
        known = [item.name for item in fields(cls)]
        unknown = [name for name in content if name not in known]
        if unknown:
            raise PlantError(f"modal data {path}: unknown {', '.join(unknown)}; known: {', '.join(known)}")
        description = str(content.pop("description", ""))
        try:
            return cls(**content, description=description)
        except PlantError as problem:
            raise PlantError(str(problem).replace("modal data", f"modal data {path}", 1)) from None

    def _check(self) -> None:
        shape: tuple[int, ...] = self.natural_frequencies.shape
        if len(shape) != 1 or shape == (0,):
            raise PlantError(f"modal data: 'natural_frequencies' has shape {shape}; (n,) is needed, for n modes")
        n = self.modes
        shapes = {
            "damping_ratios": (n,),
            "bearings": (4, n),
            "sensors": (4, n),
            "unbalance": (2, n),
            "weight": (n,),
            "gyroscopic": (n, n),
        }
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise PlantError(
                    f"modal data: '{name}' has shape {getattr(self, name).shape}; {shape} is needed, for {n} modes"
                )
        for name in _ARRAYS:
            if not np.isfinite(getattr(self, name)).all():
                raise PlantError(f"modal data: '{name}' holds values that are not finite")
        self._check_modes()
        rank = np.linalg.matrix_rank(self.bearings)
        if rank < 4:
            raise PlantError(
                "modal data: the modes do not move the journals of A and B independently along x and y: 'bearings' has "
                f"rank {rank}, needed: 4; are the four rigid body modes among the {n} modes?"
            )

    def _check_modes(self) -> None:
        """Frequencies, damping ratios and gyroscopic forces."""
        if self.natural_frequencies.min() < 0.0:
            mode = int(self.natural_frequencies.argmin())
            raise PlantError(
                f"modal data: 'natural_frequencies' has {self.natural_frequencies[mode]:g} Hz for mode {mode + 1}; "
                "allowed: 0 and above"
            )
        outside = np.flatnonzero((self.damping_ratios < 0.0) | (self.damping_ratios > 1.0))
        if outside.size:
            raise PlantError(
                f"modal data: 'damping_ratios' has {self.damping_ratios[outside[0]]:g} for mode {outside[0] + 1}; "
                "allowed: 0 to 1"
            )
        symmetric = np.abs(self.gyroscopic + self.gyroscopic.T).max()
        if symmetric > 2.0 * _SKEW_TOLERANCE * np.abs(self.gyroscopic).max():
            raise PlantError(
                "modal data: 'gyroscopic' is not skew: it plus its transpose, which must be 0, reaches "
                f"{symmetric:.3g}; its largest element is {np.abs(self.gyroscopic).max():.3g}"
            )


_ARRAYS = tuple(item.name for item in fields(ModalData) if item.name != "description")


def _read(path: str | Path) -> dict[str, NDArray[np.float64]]:
    """All arrays of an .npz file."""
    try:
        file = located(path)
        arrays = load_arrays(file)
        if list(arrays) == [file.stem]:
            raise PlantError(f"modal data {path}: is a single array (.npy); needed: an .npz with {', '.join(_ARRAYS)}")
        return arrays
    except OSError as problem:
        raise PlantError(f"modal data {shown(path)}: cannot be read: {problem.strerror}") from None
    except PlantError:
        raise
    except Exception as problem:  # zip and NumPy raise different ones for a damaged file or another format
        raise PlantError(f"modal data {path}: is not an .npz file: {' '.join(str(problem).split())}") from None
