"""The exception family of the workbench: every message says what is wrong, where, and what is allowed."""

from amb_core.ground.plain_text import plain_text


class AmbError(Exception):
    """Base of every error that the workbench raises on purpose; its text is fit to be shown to a user."""


class ParameterError(AmbError):
    """A parameter is unknown, of the wrong type or out of its range."""


class ParameterValueError(ParameterError, ValueError):
    """A parameter set made by its class from wrong values: ParameterError, and ValueError as of pydantic."""


class RecordError(AmbError, ValueError, IndexError):
    """The samples of a record of the loop do not fit together, or it lacks the steps asked for."""


class PlantError(AmbError):
    """The plant cannot be built, or its state has left the range in which the model holds."""


class MachineError(AmbError):
    """The description of a machine is missing, or contradicts itself."""


class ExcitationError(AmbError):
    """An excitation is asked for that cannot be generated at the sample rate of the loop."""


class MessageError(AmbError):
    """What arrived on a topic cannot be read as a message of its type."""


class BagError(AmbError):
    """A bag is missing, unreadable, or lacks what is asked of it."""


class IdentificationError(AmbError):
    """The data do not determine the model asked for."""


class RobustnessError(AmbError):
    """A robustness analysis that its loop, model or settings do not allow."""


class RegionError(AmbError):
    """Telemetry cannot be classified into regions of operation, or a region map cannot be made, read or used."""


class SpectrumError(AmbError):
    """The response to tones cannot be analysed."""


class TargetError(AmbError):
    """A real-time target, or what is to be sent to it, is not as its protocol allows."""


class TaskError(AmbError):
    """A task cannot be run: no scheduler, no worker, or what the task itself raised."""


class MissingExtraError(AmbError, ImportError):
    """A package of an optional part is not installed."""


LONGEST_TEXT = 2_000  # characters
_LEFT_OUT = " ... "


def one_line(problem: object, longest: int = LONGEST_TEXT) -> str:
    """The text of a problem as one line of bounded length, whatever names and values from outside it repeats."""
    return bounded(" ".join(str(problem).split()), longest)


def bounded(text: str, longest: int = LONGEST_TEXT) -> str:
    """A text as `plain_text`, of at most that many characters: the middle of a longer one is left out."""
    text = plain_text(text)
    if len(text) <= longest:
        return text
    half = (longest - len(_LEFT_OUT)) // 2
    return f"{text[:half]}{_LEFT_OUT}{text[-half:]}"


class ProjectError(AmbError):
    """A project's folder cannot be read."""
