"""Many messages of one kind at once: serialized one time, and then filled with the numbers of each sample.

Such messages have one length, and every number its place. That is some ten times faster than to serialize each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

SECOND = 1_000_000_000  # ns


class MessageRows:
    """Serialized messages (CDR) of one kind with a stamp and numbers.

    Parameters
    ----------
    serialize : callable
        Makes a message from seconds, nanoseconds, a list of whole numbers and a list of doubles. Its length must not
        depend on them.
    integers, doubles : int
        How many whole numbers (`uint64`) and doubles it has.
    """

    def __init__(
        self,
        serialize: Callable[[int, int, list[int], list[float]], bytes],
        integers: int,
        doubles: int,
    ) -> None:
        # numbers that no message has otherwise, to find their places
        seconds, nanoseconds = 0x5AFE_1234, 0x2BAD_4321
        whole = [0x1357_9BDF_0246_8ACE + number for number in range(integers)]
        real = [-1.2345678e-300 * (1.0 + number) for number in range(doubles)]
        self._template = np.frombuffer(serialize(seconds, nanoseconds, whole, real), dtype=np.uint8)
        stamp = [self._place(np.int32(seconds)), self._place(np.uint32(nanoseconds))]
        self._places = [
            *stamp,
            *(self._place(np.uint64(value)) for value in whole),
            *(self._place(np.float64(value)) for value in real),
        ]
        self._types = ["<i4", "<u4", *["<u8"] * integers, *["<f8"] * doubles]

    def messages(self, time: NDArray[np.int64], columns: Sequence[NDArray[np.generic]]) -> Iterator[bytes]:
        """The messages of samples.

        Parameters
        ----------
        time : ndarray, shape (n,)
            Stamps (ns).
        columns : sequence of ndarray, each of shape (n,)
            The whole numbers, and then the doubles.
        """
        rows = np.tile(self._template, (len(time), 1))
        for place, kind, values in zip(
            self._places, self._types, [time // SECOND, time % SECOND, *columns], strict=True
        ):
            raw = np.ascontiguousarray(values, dtype=kind)
            rows[:, place : place + raw.itemsize] = raw.view(np.uint8).reshape(len(time), raw.itemsize)
        size, content = len(self._template), rows.tobytes()
        return (content[start : start + size] for start in range(0, len(content), size))

    def _place(self, value: np.generic) -> int:
        content, wanted = self._template.tobytes(), value.tobytes()
        if content.count(wanted) != 1:
            raise ValueError("the place of a number in the message is not unique")
        return content.index(wanted)
