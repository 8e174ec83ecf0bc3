"""Uploads to a target: an excitation or a state-space controller, in chunks that may be lost and are sent again."""

from __future__ import annotations

import struct
import zlib

import numpy as np
from numpy.typing import ArrayLike

from amb_core.ground.errors import TargetError
from amb_core.linear.model import StateSpaceModel
from amb_core.loop.linear_parameters import state_at_rest
from amb_core.rig.link.commands import Command
from amb_core.rig.link.layout import CHUNK, FrameType, UploadKind


class Upload:
    """The commands of one upload.

    Parameters
    ----------
    number : int
        Number of the upload, 1 to 2^32 - 1.
    kind : UploadKind
        What is uploaded.
    content : bytes
        At least 1 byte, less than 4 GiB.
    order : int
        States of a controller; 0 for an excitation.
    inputs : int
        Inputs of a controller; 0 for an excitation.
    steps : int
        Steps of an excitation; 0 for a controller.

    Attributes
    ----------
    id : int
        Its number, not 0.
    chunks : int
        Number of chunks.
    begin, bitmap, commit : Command
        Announce it, ask which chunks have arrived, have the whole checked. Repeat `commit` while its reply is BUSY.

    Raises
    ------
    TargetError
        If number or size are not allowed.
    """

    def __init__(self, number: int, kind: UploadKind, content: bytes, order: int, inputs: int, steps: int) -> None:
        if not 1 <= number < 1 << 32 or not content or len(content) >= 1 << 32:
            raise TargetError(f"upload {number} of {len(content)} bytes; allowed: a number from 1, and 1 byte to 4 GiB")
        self.id, self._content = number, content
        self.chunks = -(-len(content) // CHUNK)
        checksum = zlib.crc32(content)
        header = struct.pack("<BBHHHIIII", kind, 0, order, inputs, 0, number, len(content), checksum, steps)
        self.begin = Command(FrameType.BEGIN, header)
        self.bitmap = Command(FrameType.BITMAP, struct.pack("<I", number))
        self.commit = Command(FrameType.COMMIT, struct.pack("<I", number))

    def chunk(self, index: int) -> Command:
        """The command that carries a chunk; the target does not reply to it.

        Parameters
        ----------
        index : int
            Number of the chunk, from 0.

        Returns
        -------
        Command
            Command of type DATA.

        Raises
        ------
        IndexError
            If there is no such chunk.
        """
        if not 0 <= index < self.chunks:
            raise IndexError(f"chunk {index} asked for; there are {self.chunks}")
        part = self._content[index * CHUNK : (index + 1) * CHUNK]
        return Command(FrameType.DATA, struct.pack("<II", self.id, index) + part)


def excitation_upload(number: int, samples: ArrayLike) -> Upload:
    """Upload of an excitation: samples of shape (steps, axes) (m), bit for bit.

    Parameters
    ----------
    number : int
        Number of the upload.
    samples : array_like, shape (steps, axes)
        Excitation of each axis (m).

    Returns
    -------
    Upload
        The commands that bring it to the target.

    Raises
    ------
    TargetError
        If they are empty, of another shape or not finite.
    """
    values = np.ascontiguousarray(samples, dtype="<f8")
    if values.ndim != 2 or not values.size:
        raise TargetError(f"an excitation of shape {values.shape}; allowed: (steps, axes)")
    if not np.isfinite(values).all():
        raise TargetError("the excitation has samples that are not finite")
    return Upload(number, UploadKind.EXCITATION, values.tobytes(), 0, 0, len(values))


def controller_upload(number: int, model: StateSpaceModel) -> Upload:
    """Upload of a linear controller (see `LinearController`), with its anti-windup gain K.

    Parameters
    ----------
    number : int
        Number of the upload.
    model : StateSpaceModel
        The controller, from errors or positions to control currents.

    Returns
    -------
    Upload
        The commands that bring it to the target.
    """
    parts = (model.a, model.b, model.c, model.d, model.k, state_at_rest(model), model.input_offset, model.output_offset)
    content = b"".join(np.ascontiguousarray(part, dtype="<f8").tobytes() for part in parts)
    return Upload(number, UploadKind.STATE_SPACE, content, model.order, len(model.input_names), 0)
