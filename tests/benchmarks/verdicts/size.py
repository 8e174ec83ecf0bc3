"""How much is measured."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Size:
    """Sizes of the populations.

    Attributes
    ----------
    models : int
        True models; there are twice as many wrong ones that can be told.
    steps : int
        Samples of an experiment.
    """

    models: int = 200
    steps: int = 10_000


SMALLEST = Size(2, 4_000)
"""What `--quick` takes."""
