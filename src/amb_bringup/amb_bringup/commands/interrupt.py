"""Ctrl-C during a long computation of tasks: it ends orderly, and what is finished is kept."""

from __future__ import annotations

import signal


class Interrupt:
    """In this context Ctrl-C requests the end instead of forcing it: finished sweeps are kept."""

    def __init__(self) -> None:
        self._asked_to_end = False

    def __enter__(self) -> Interrupt:
        self._handler = signal.signal(signal.SIGINT, self._on_interrupt)
        return self

    def __exit__(self, *problem: object) -> None:
        signal.signal(signal.SIGINT, self._handler)

    def _on_interrupt(self, *_: object) -> None:
        self._asked_to_end = True

    def asked(self) -> bool:
        """Whether Ctrl-C was pressed."""
        return self._asked_to_end
