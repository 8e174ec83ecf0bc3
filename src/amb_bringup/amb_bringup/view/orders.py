"""Orders from the live page: excite, record, map, identify, certify, run the simulator, levitate or land a rig."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from typing import Any

from amb_bringup.client import AmbClient
from amb_bringup.client.errors import ClientError
from amb_core.excitation import KINDS, excitation_from_request
from amb_core.ground.errors import AmbError, one_line
from amb_core.ground.parameters import Declaration, declarations
from amb_core.identification import METHODS, IdentificationProgress
from amb_core.identification.estimate.scaled_data import HIGHEST_ORDER
from amb_core.identification.fit import fit_text
from amb_core.regions.region_map import MapProgress
from amb_msgs.srv import RunSteps, StartRecording, StopRecording

_PATIENCE = 10.0  # s; longest wait for a service

Settings = Mapping[str, Any]
Report = Callable[[str], None]


class Orders:
    """Carries out orders, each in the thread of its lane, so that none waits for a long one of another lane.

    What ends something has a lane of its own: it waits for nothing.

    Parameters
    ----------
    present_run : callable
        Returns the run that the page shows.
    """

    def __init__(self, present_run: Callable[[], int]) -> None:
        self._present_run = present_run
        self._lanes: dict[str, _Lane] = {}
        self._orders: dict[str, tuple[str, Callable[[AmbClient, Settings, Report], str]]] = {
            "start_excitation": ("control", self._start_excitation),
            "stop_excitation": ("stop_excitation", _stop_excitation),
            "start_recording": ("recording", _start_recording),
            "stop_recording": ("stop_recording", _stop_recording),
            "run": ("simulator", _run),
            "pause": ("pause", lambda client, _settings, _report: f"paused at step {client.pause()}"),
            "reset": ("simulator", lambda client, _settings, _report: f"reset; run {client.reset()}"),
            "off": ("off", _off),
            "reset_trip": ("rig", _reset_trip),
            "certify": ("identification", _certify),
            "build_map": ("map", _build_map),
            "levitate": ("rig", lambda client, _settings, _report: f"levitated; run {client.rig.levitate()}"),
            "land": ("land", _land),
            "identify": ("identification", _identify),
        }

    def lane(self, order: object) -> Executor:
        """The thread that carries an order out.

        Raises
        ------
        ClientError
            If there is no such order.
        """
        if not isinstance(order, str) or order not in self._orders:
            raise ClientError(f"unknown order {_shown(order)}; allowed: {', '.join(self._orders)}")
        return self._of(self._orders[order][0]).executor

    def carry_out(self, order: str, settings: object, report: Report) -> str:
        """Carry an order out, in its lane; what has been done, in one line.

        Raises
        ------
        AmbError
            If it is not possible.
        """
        lane, do = self._orders[order]
        if not isinstance(settings, dict):
            raise ClientError(f"settings of {order} are {_shown(settings)}; allowed: an object")
        client = self._of(lane).client()
        client.use_run(self._present_run())
        return do(client, settings, report)

    def close(self) -> None:
        """Take no more orders, and leave the graph where no order is being carried out."""
        for lane in self._lanes.values():
            lane.close()

    def _of(self, name: str) -> _Lane:
        return self._lanes.setdefault(name, _Lane())

    def _start_excitation(self, client: AmbClient, settings: Settings, _report: Report) -> str:
        given = dict(settings)
        kind = given.pop("kind", "")
        excitation = excitation_from_request(kind if isinstance(kind, str) else repr(kind), given)
        started = client.start_excitation(excitation.kind, **excitation.model_dump())
        return f"{excitation.kind} from step {started.first_step}, {started.steps} steps"


class _Lane:
    """A thread with a client of its own, made at the first order: an AmbClient serves one thread."""

    def __init__(self) -> None:
        self.executor = ThreadPoolExecutor(1)
        self._client: AmbClient | None = None

    def client(self) -> AmbClient:
        if self._client is None:
            self._client = AmbClient(timeout=_PATIENCE)
        return self._client

    def close(self) -> None:
        def leave() -> None:
            if self._client is not None:
                self._client.close()

        self.executor.submit(leave)
        self.executor.shutdown(wait=False)


def _stop_excitation(client: AmbClient, _settings: Settings, _report: Report) -> str:
    client.stop_excitation()
    return "excitation stopped"


def _start_recording(client: AmbClient, _settings: Settings, _report: Report) -> str:
    # The recorder names the bag: the page gives no path. All nodes run already, so there is none to wait for.
    return f"recording to {client.call(StartRecording, 'recorder/start').uri}"


def _stop_recording(client: AmbClient, _settings: Settings, _report: Report) -> str:
    answer = client.call(StopRecording, "recorder/stop", timeout=2.0 * _PATIENCE)
    return f"recorded {answer.messages} messages to {answer.uri}"


def _run(client: AmbClient, settings: Settings, _report: Report) -> str:
    in_real_time = settings.get("real_time", False)
    if not isinstance(in_real_time, bool):
        raise ClientError(f"real_time = {_shown(in_real_time)} is not allowed; allowed: true or false")
    started = client.call(RunSteps, "simulator/run", steps=0, real_time_factor=1.0 if in_real_time else 0.0)
    return f"runs from step {started.first_step}{' in real time' if in_real_time else ''} until paused"


def _land(client: AmbClient, _settings: Settings, _report: Report) -> str:
    client.rig.land()
    return "landed"


def _off(client: AmbClient, _settings: Settings, _report: Report) -> str:
    client.rig.off()
    return "off: the currents are switched off"


def _reset_trip(client: AmbClient, _settings: Settings, _report: Report) -> str:
    client.rig.reset_faults()
    return "trip reset; the rotor can be levitated again"


def _certify(client: AmbClient, _settings: Settings, report: Report) -> str:
    report("certifying the last model with the controller of its experiment")
    answer = client.certify()
    return " ".join([answer.verdict, *(f"Not met: {text}" for text in answer.reasons[:1])])


def _build_map(client: AmbClient, _settings: Settings, report: Report) -> str:
    def on_progress(progress: MapProgress) -> None:
        report(f"sweeps: {progress.done} of {progress.total}")

    region_map = client.build_map(progress=on_progress)
    resolved = "" if region_map.complete else "; not all boundaries are resolved, max_sweeps are done"
    return f"region map of {len(region_map.amplitudes)} amplitudes{resolved}"


def _identify(client: AmbClient, settings: Settings, report: Report) -> str:
    order, method = settings.get("order", 0), settings.get("method", "")
    if order != "auto" and not (type(order) is int and 0 <= order <= HIGHEST_ORDER):
        raise ClientError(f"order = {_shown(order)} is not allowed; allowed: auto, or 0 (default) to {HIGHEST_ORDER}")
    if method not in ("", *METHODS):
        raise ClientError(f"method = {_shown(method)} is not allowed; allowed: {', '.join(METHODS)}")

    def on_progress(progress: IdentificationProgress) -> None:
        report(f"{progress.stage}: {progress.done} of {progress.total}")

    model = client.identify(order=order, method=method, progress=on_progress)
    fit = ", ".join(fit_text(value) for value in model.fit)
    verdict = model.verdict.replace("_", " ")
    return f"{verdict} on the data of the estimate: model of order {model.order} by {model.method}" + (
        f", fit {fit}" if fit else ""
    )


def forms() -> dict[str, Any]:
    """What the page may ask for: the kinds of excitation with their settings as declared, and methods."""
    return {
        "excitations": {name: [_field(item) for item in declarations(kind)] for name, kind in KINDS.items()},
        "methods": list(METHODS),
    }


def reason(problem: Exception) -> str:
    """Why an order was not carried out, in one line."""
    return one_line(problem) if isinstance(problem, AmbError) else f"internal error: {problem!r}"


def _field(item: Declaration) -> dict[str, Any]:
    default = item.default if isinstance(item.default, str | bool | int | float) else None
    return {
        "name": item.name,
        "type": "list" if item.type is tuple else item.type.__name__,
        "default": default,
        "unit": item.unit,
        "description": item.description,
        "minimum": item.minimum,
        "maximum": item.maximum,
        "choices": list(item.choices),
    }


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:80]}…"
