"""The linear system of the workbench: state-space matrices, sample time, names and units of its signals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from amb_core.ground.errors import IdentificationError
from amb_core.ground.extras import extra
from amb_core.ground.given_values import kind_of
from amb_core.linear.control_names import control_names
from amb_core.linear.resolvent import Arrays, Complexes, response, response_and_slope

if TYPE_CHECKING:
    import control


def rates_of(poles: Complexes, sample_time: float) -> Complexes:
    """Poles z of a discrete system as rates s = ln(z) / T (1/s), with -inf for z = 0.

    Parameters
    ----------
    poles : ndarray of complex, shape (n,)
        Poles z (-).
    sample_time : float
        Sample time (s).

    Returns
    -------
    ndarray of complex, shape (n,)
        Rates (1/s).
    """
    with np.errstate(divide="ignore"):
        return np.log(np.abs(poles)) / sample_time + 1j * np.angle(poles) / sample_time


def _matrix(name: str, values: ArrayLike) -> Arrays:
    """A matrix of numbers; IdentificationError for anything else."""
    try:
        matrix = np.asarray(values)
    except ValueError:  # rows of different lengths
        matrix = np.empty(0)
    if matrix.ndim != 2 or matrix.dtype.kind not in "fciu":
        raise IdentificationError(f"{name}: {kind_of(values)} is not allowed; allowed: a matrix of numbers")
    return matrix


def real_array(name: str, values: object) -> Arrays:
    """A copy of an array of real numbers; IdentificationError for anything else, also for imaginary parts."""
    try:
        given = np.asarray(values)
        if not (np.iscomplexobj(given) and np.any(given.imag)):
            return np.array(given.real if np.iscomplexobj(given) else given, dtype=np.float64, order="C")
    except (TypeError, ValueError):  # texts, rows of different lengths
        pass
    raise IdentificationError(f"{name}: {kind_of(values)} is not allowed; allowed: an array of real numbers")


class LinearSystem:
    """x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k]; in continuous time dx/dt = A x + B u.

    A parent too, for systems that have more than that, such as noise and offsets: they have these attributes, and
    whatever makes another system of them makes a `LinearSystem`.

    Parameters
    ----------
    a, b, c, d : ndarray, shapes (n, n), (n, m), (p, n), (p, m)
        Matrices, in the units of the signals.
    sample_time : float
        Sample time (s); 0 in continuous time.
    input_names, output_names, state_names : tuple of str, optional
        Names of the signals and states; empty where they have none.
    input_units, output_units : tuple of str, optional
        Units of the signals; empty where they are not given.

    Raises
    ------
    IdentificationError
        If the shapes of the matrices do not fit together, or one is no matrix of numbers.
    """

    a: Arrays
    b: Arrays
    c: Arrays
    d: Arrays
    sample_time: float
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]
    state_names: tuple[str, ...] = ()

    def __init__(
        self,
        a: Arrays,
        b: Arrays,
        c: Arrays,
        d: Arrays,
        sample_time: float,
        input_names: Sequence[str] = (),
        output_names: Sequence[str] = (),
        input_units: Sequence[str] = (),
        output_units: Sequence[str] = (),
        state_names: Sequence[str] = (),
    ) -> None:
        self.a, self.b, self.c, self.d = (
            _matrix(name, matrix) for name, matrix in (("A", a), ("B", b), ("C", c), ("D", d))
        )
        shapes = [matrix.shape for matrix in (self.a, self.b, self.c, self.d)]
        (n, _), (p, m) = shapes[0], shapes[3]
        if shapes[:3] != [(n, n), (n, m), (p, n)]:
            raise IdentificationError(
                f"A, B, C, D of shapes {', '.join(map(str, shapes))} are not allowed; allowed: (n, n), (n, m), (p, n), "
                "(p, m)"
            )
        self.sample_time = sample_time
        self.input_names, self.output_names = tuple(input_names), tuple(output_names)
        self.input_units, self.output_units = tuple(input_units), tuple(output_units)
        self.state_names = tuple(state_names)

    @property
    def order(self) -> int:
        """Number of states n."""
        return len(self.a)

    @property
    def inputs(self) -> int:
        """Number of inputs m."""
        return int(self.d.shape[1])

    @property
    def outputs(self) -> int:
        """Number of outputs p."""
        return int(self.d.shape[0])

    def poles(self) -> Complexes:
        """Poles, in the z plane or for continuous time in the s plane, largest magnitude first, shape (n,).

        Returns
        -------
        ndarray of complex, shape (n,)
            Eigenvalues of A: z (-), or s (rad/s).
        """
        poles = np.linalg.eigvals(self.a).astype(np.complex128)
        return np.asarray(poles[np.argsort(-np.abs(poles), kind="stable")])

    @property
    def radius(self) -> float:
        """Largest magnitude of a pole; 0 without states."""
        return float(np.abs(self.poles()).max(initial=0.0))

    def at(self, points: ArrayLike) -> Complexes:
        """C (z I - A)^-1 B + D at points z (s in continuous time), shape (points, p, m); infinite at a pole.

        Parameters
        ----------
        points : array_like of complex, shape (points,)
            Points z (-), or s (rad/s).

        Returns
        -------
        ndarray of complex, shape (points, p, m)
            Response at each point.
        """
        return response(self.a, self.b, self.c, self.d, np.atleast_1d(np.asarray(points, dtype=np.complex128)))

    def response(self, frequency: ArrayLike) -> Complexes:
        """Frequency response at frequencies in Hz, shape (f, p, m); infinite at a pole.

        Parameters
        ----------
        frequency : array_like, shape (f,)
            Frequencies (Hz).

        Returns
        -------
        ndarray of complex, shape (f, p, m)
            Response at each frequency.
        """
        rates = 2j * np.pi * np.asarray(frequency, dtype=np.float64)
        return self.at(np.exp(rates * self.sample_time) if self.sample_time else rates)

    def slope_at(self, point: complex) -> tuple[Complexes, Complexes]:
        """The response at a point z and its derivative by z, both of shape (p, m); LinAlgError at a pole.

        Parameters
        ----------
        point : complex
            A point z (-).

        Returns
        -------
        tuple of ndarray of complex, shape (p, m)
            Response, and its derivative by z.
        """
        value, slope = response_and_slope(self.a, self.b, self.c, self.d, np.array([point]))
        return value[0], slope[0]

    def gain(self, frequency: float) -> float:
        """Largest singular value at a frequency (Hz).

        Parameters
        ----------
        frequency : float
            Frequency (Hz).

        Returns
        -------
        float
            Largest singular value of the response there, in its unit.
        """
        return float(np.linalg.norm(self.response([frequency])[0], 2))

    def balanced(self) -> LinearSystem:
        """The same system with states of similar size: the columns and rows of [A B; C 0] have similar norms.

        Returns
        -------
        LinearSystem
            The system in scaled states.
        """
        from scipy.linalg import matrix_balance  # a fifth of a second to import, for those who need it

        n = self.order
        if not n or not (np.any(self.b) and np.any(self.c)):
            return self
        whole = np.zeros((n + 1, n + 1))  # inputs together and outputs together as one signal
        whole[:n, :n] = self.a
        whole[:n, n], whole[n, :n] = np.linalg.norm(self.b, axis=1), np.linalg.norm(self.c, axis=0)
        # As one signal they are balanced first: else the states' sizes would depend on the units of a gain.
        whole[n] *= np.linalg.norm(whole[:n, n]) / np.linalg.norm(whole[n])
        scale = matrix_balance(whole, permute=False, separate=True)[1][0][:n]
        if not np.all(np.isfinite(scale)) or np.any(scale <= 0.0):
            return self
        return self.with_matrices(
            self.a * scale / scale[:, np.newaxis], self.b / scale[:, np.newaxis], self.c * scale, self.d
        )

    def with_matrices(self, a: Arrays, b: Arrays, c: Arrays, d: Arrays) -> LinearSystem:
        """Other matrices between the same signals.

        Parameters
        ----------
        a, b, c, d : ndarray, shapes (n, n), (n, m), (p, n), (p, m)
            New matrices (units of the signals); the number of states may differ.

        Returns
        -------
        LinearSystem
            The system with these matrices.
        """
        names = self.state_names if len(a) == self.order else ()
        return LinearSystem(
            a, b, c, d, self.sample_time,
            self.input_names, self.output_names, self.input_units, self.output_units, names,
        )  # fmt: skip

    def named(
        self, inputs: Sequence[str] = (), outputs: Sequence[str] = (), states: Sequence[str] = ()
    ) -> LinearSystem:
        """The system with other names; what is not given keeps its own.

        Parameters
        ----------
        inputs, outputs, states : sequence of str, optional
            New names; an empty sequence keeps the names.

        Returns
        -------
        LinearSystem
            The same system under the new names.
        """
        return LinearSystem(
            self.a, self.b, self.c, self.d, self.sample_time, inputs or self.input_names, outputs or self.output_names,
            self.input_units, self.output_units, states or self.state_names,
        )  # fmt: skip

    def part(self, outputs: list[int] | slice, inputs: list[int] | slice) -> LinearSystem:
        """The system with some of its outputs and inputs.

        Parameters
        ----------
        outputs, inputs : list of int or slice
            Indices of the signals to keep.

        Returns
        -------
        LinearSystem
            The system between these signals, with all its states.
        """
        return LinearSystem(
            self.a, self.b[:, inputs], self.c[outputs], self.d[outputs][:, inputs], self.sample_time,
            _chosen(self.input_names, inputs), _chosen(self.output_names, outputs),
            _chosen(self.input_units, inputs), _chosen(self.output_units, outputs), self.state_names,
        )  # fmt: skip

    def plus(self, matrix: Arrays) -> LinearSystem:
        """The system with a constant matrix added.

        Parameters
        ----------
        matrix : ndarray, shape (p, m)
            Added to D, in the unit of the response.

        Returns
        -------
        LinearSystem
            The sum.
        """
        return self.with_matrices(self.a, self.b, self.c, self.d + matrix)

    def scaled(self, outputs: Arrays | float, inputs: Arrays | float) -> LinearSystem:
        """The system with factors on its outputs and inputs, one for all or one each.

        Parameters
        ----------
        outputs, inputs : float or ndarray, shapes (p,), (m,)
            Factors of the signals (-).

        Returns
        -------
        LinearSystem
            The scaled system.
        """
        rows, columns = np.broadcast_to(outputs, self.outputs)[:, np.newaxis], np.broadcast_to(inputs, self.inputs)
        return self.with_matrices(self.a, self.b * columns, rows * self.c, rows * self.d * columns)

    def delayed(self) -> LinearSystem:
        """The system with its outputs one step later: they are states.

        Returns
        -------
        LinearSystem
            The delayed system, of n + p states.
        """
        (n, m), p = self.b.shape, len(self.c)
        a = np.block([[self.a, np.zeros((n, p))], [self.c, np.zeros((p, p))]])
        c = np.hstack([np.zeros((p, n)), np.eye(p)])
        return self.with_matrices(a, np.vstack([self.b, self.d]), c, np.zeros((p, m)))

    def to_control(self, **names: Any) -> control.StateSpace:
        """The system for python-control.

        Parameters
        ----------
        **names : Any
            Further keywords of `control.StateSpace`, such as `name`.

        Returns
        -------
        control.StateSpace
            The same matrices, sample time and names of signals, with underscores for dots, which it refuses.
        """
        with extra("control"):
            import control  # the import takes a second; programs that do not need it should not wait for it

        signals = {"inputs": self.input_names, "outputs": self.output_names, "states": self.state_names}
        given = {kind: control_names(value) for kind, value in signals.items() if value}
        return control.StateSpace(self.a, self.b, self.c, self.d, self.sample_time, **given, **names)

    @classmethod
    def from_control(cls, system: control.StateSpace) -> LinearSystem:
        """The system that python-control has.

        Parameters
        ----------
        system : StateSpace
            System of python-control, in discrete or continuous time.

        Returns
        -------
        LinearSystem
            The same matrices, sample time and names of signals.

        Raises
        ------
        IdentificationError
            If a matrix has imaginary parts.
        """
        a, b, c, d = (real_array(name, getattr(system, name)) for name in "ABCD")
        return cls(
            a, b, c, d, float(system.dt or 0.0),
            input_names=tuple(system.input_labels), output_names=tuple(system.output_labels),
            state_names=tuple(system.state_labels),
        )  # fmt: skip


def _chosen(names: Sequence[str], places: list[int] | slice) -> tuple[str, ...]:
    if not names:
        return ()
    return tuple(names[places]) if isinstance(places, slice) else tuple(names[place] for place in places)
