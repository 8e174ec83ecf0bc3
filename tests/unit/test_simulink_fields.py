"""The fields of telemetry that the documentation gives for a Byte Unpack block are those of a frame of the target."""

from __future__ import annotations

import zlib

import numpy as np
import pytest

from amb_core.rig.link import TelemetryBlock, commands, decode
from amb_core.rig.link.layout import MAGIC, FrameType, TelemetryOption
from docs.generators.simulink import SIZES, telemetry_fields, telemetry_table
from tests.target_rig import Rig


@pytest.mark.parametrize("options", [0, 4, 5, 6, 7])
@pytest.mark.parametrize("axes", [2, 4])
def test_a_frame_of_the_target_has_these_fields(axes: int, options: int) -> None:
    coils = 2 * axes
    rig = Rig(axes, coils=coils)
    rig.command(commands.stream(1, options))
    rig.target.coil_current[:] = 0.25 * np.arange(coils)
    rig.target.position[:] = 1e-6 * np.arange(1, axes + 1)
    rig.target.step()
    frame = next(frame for frame, _ in rig.target.take() if frame[5] == FrameType.TELEMETRY)
    fields = telemetry_fields(axes, coils, TelemetryOption(options))
    assert fields[-1].offset + SIZES[fields[-1].type] == len(frame)
    values = {
        one.name: np.frombuffer(frame, np.dtype(one.type).newbyteorder("<"), one.count, one.offset) for one in fields
    }
    block = decode(frame, rig.session)
    assert isinstance(block, TelemetryBlock)
    assert values["magic"].tobytes() == MAGIC
    assert values["step of the first sample"] == block.first_step
    assert values["positions (m)"].tolist() == block.position[0].tolist()
    assert values["control currents (A)"].tolist() == block.current[0].tolist()
    assert values["checksum"] == zlib.crc32(frame[:-4])
    assert ("coil currents (A)" in values) == bool(options & TelemetryOption.COILS)


def test_the_page_has_what_is_typed_in() -> None:
    table = telemetry_table(4)
    assert "{4, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 4, 4, 4, 1, 1}" in table
    assert "A frame has 88 bytes" in table
