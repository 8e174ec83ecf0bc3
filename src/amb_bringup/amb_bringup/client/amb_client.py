"""`AmbClient`: the services of the graph as plain Python calls, with timeouts and clear errors.

with AmbClient() as amb:
    run = amb.reset()
    amb.start_excitation("square", amplitude=50e-6, duration=4.0, first_step=2000)
    amb.run(42_000)
    model = amb.identify(order=10)
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from amb_bringup.client.errors import ClientError
from amb_bringup.client.experiment import Experiment, ExperimentRun, carry_out
from amb_bringup.client.loop_calls import LoopCalls
from amb_core.excitation import excitation_from_settings
from amb_core.ground.parameters import validate
from amb_core.ground.progress import Progress, unseen

if TYPE_CHECKING:
    from amb_core.robustness import MeasuredSensitivity


class AmbClient(LoopCalls):
    """Calls the nodes of one graph; see `GraphConnection` for errors and further methods.

    Parameters
    ----------
    namespace : str, optional
        Namespace of the nodes.
    timeout : float, optional
        Longest wall-clock wait for a node to appear, to answer or, while running, to advance (s).
    domain_id : int, optional
        DDS domain of the graph, 0 to 232; ROS_DOMAIN_ID by default.
    nodes : sequence of str, optional
        The nodes of the graph, relative to the namespace; by default those of a simulation.
    """

    def experiment(
        self,
        kind: str | Sequence[Experiment],
        bag: str | Path | None = None,
        progress: Progress = unseen,
        **settings: Any,
    ) -> list[ExperimentRun]:
        """Levitate, excite, record, land: an experiment from start to end, or several, on simulator or rig.

        Parameters
        ----------
        kind : str or sequence of Experiment
            Kind of the excitation, with `settings`; or several experiments.
        bag : str or Path, optional
            New folder in which everything is recorded. None to record nothing.
        progress : callable, optional
            Called with the name of the stage, the number of finished steps and the number of all steps.
        **settings : object
            Fields of the excitation in SI units: amplitude, duration, axes, ...

        Returns
        -------
        list of ExperimentRun
            Run, first step and number of steps of each.

        Raises
        ------
        AmbError
            If an excitation is wrong, a node fails, the rotor falls, or a target trips; the rotor is landed, the bag
            closed.
        EndError
            If that fails: the text says what is left to do.
        ClientError
            If settings are given with several experiments.
        """
        if isinstance(kind, str):
            return carry_out(self, [Experiment(kind, excitation_from_settings(kind, settings))], bag, progress)
        if settings:
            raise ClientError(f"settings are for one kind of excitation; not allowed here: {', '.join(settings)}")
        return carry_out(self, kind, bag, progress)

    def measure_sensitivity(
        self,
        bag: str | Path,
        controller: str = "",
        progress: Progress = unseen,
        **settings: Any,
    ) -> MeasuredSensitivity:
        """Measure the sensitivity of the running loop by a swept sine and dwells at its peaks, in region A.

        Parameters
        ----------
        bag : str or Path
            New folder in which everything is recorded; `certify` takes it as `sweep_bag`.
        controller : str, optional
            The controller, as for `identify`; by default the recorded one.
        progress : callable, optional
            As for `experiment`.
        **settings : object
            As in `amb_core.robustness.SweepSettings`: sweep_amplitude (m), which must be given, and sweep_duration (s),
            sweep_start and sweep_end (Hz).

        Returns
        -------
        MeasuredSensitivity
            With deviations and coherence; `difference_db(feedback_of(model, controller))` compares it with a model.

        Raises
        ------
        AmbError
            As for `experiment`; and if the data do not determine the sensitivity.
        ClientError
            If no controller is named and none was recorded.
        """
        from amb_bringup.client.swept_sensitivity import measure_swept  # loads compilers, which other calls do not need
        from amb_core.robustness import SweepSettings, measured_sensitivity
        from amb_core.robustness.sweep import modes_of

        loop, modes = measure_swept(self, validate(SweepSettings, settings), bag, controller, progress)
        if loop.controller is None:
            raise ClientError(f"bag {bag}: lacks the parameters of the controller; name it in `controller`")
        modes = modes_of(loop.data, loop.controller) if modes is None else modes
        return measured_sensitivity(loop.data, loop.controller, modes)
