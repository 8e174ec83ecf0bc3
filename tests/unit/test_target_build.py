"""The C target as an embedded engineer gets it: size, memory, what it calls, and a run over real UDP."""

from __future__ import annotations

import re
import socket
import subprocess
from pathlib import Path

import pytest

from amb_core.ground.errors import TargetError
from amb_core.rig.link import (
    Code,
    CommandWriter,
    Description,
    Refusal,
    Reply,
    TargetState,
    TelemetryBlock,
    TelemetryOption,
    build_library,
    commands,
    decode,
    hello,
    machine_of,
)
from amb_core.rig.link.reference import COMPILER, SOURCE

CORE = sorted([*SOURCE.glob("*.c"), *SOURCE.glob("*.h")])
KEY = bytes(range(16))


def test_it_has_at_most_1200_lines() -> None:
    assert sum(len(file.read_text().splitlines()) for file in CORE) <= 1200


def test_it_calls_nothing_but_mathematics_memory_and_its_board(tmp_path: Path) -> None:
    sources = [*(file for file in CORE if file.suffix == ".c"), SOURCE / "ports" / "stream.c"]
    subprocess.run([*COMPILER, "-O2", "-c", *sources], check=True, cwd=tmp_path)
    named = subprocess.run(["nm", *tmp_path.glob("*.o")], check=True, capture_output=True, text=True).stdout
    needed = set(re.findall(r" U (\w+)", named)) - set(re.findall(r" T (\w+)", named))
    board = set(re.findall(r"(board_\w+)\(", (SOURCE / "board.h").read_text()))
    assert needed - board <= {
        "memcpy", "memset", "memcmp", "sqrt", "floor", "ceil", "fmax", "fmin", "__stack_chk_fail",
        "_GLOBAL_OFFSET_TABLE_",
    }  # fmt: skip
    assert board <= needed
    kept = subprocess.run(["size", *tmp_path.glob("*.o")], check=True, capture_output=True, text=True).stdout
    assert {tuple(line.split()[1:3]) for line in kept.splitlines()[1:]} == {("0", "0")}  # nothing outside its struct


def test_it_needs_at_most_16_kib_besides_the_waveform_buffer(tmp_path: Path) -> None:
    unit = tmp_path / "memory.c"
    unit.write_text('#include "amb_target.h"\nstruct amb_target target;\n')
    subprocess.run([*COMPILER, f"-I{SOURCE}", "-c", unit, "-o", tmp_path / "memory.o"], check=True)
    size = subprocess.run(["size", tmp_path / "memory.o"], check=True, capture_output=True, text=True).stdout
    assert int(size.splitlines()[1].split()[2]) <= 16 * 1024


def test_every_trip_and_code_has_the_number_that_the_c_code_gives_it(tmp_path: Path) -> None:
    from amb_core.rig.link import ExcitationPhase, FrameType, TargetState, TripReason

    names = {
        **{f"AMB_{code.name}": code for code in Code if code.name != "CHECKSUM"},
        **{f"AMB_{state.name}": state for state in TargetState},
        **{f"AMB_{reason.name}": reason for reason in TripReason},
        **{f"AMB_{kind.name}": kind for kind in FrameType},
        **{f"AMB_{phase.name}": phase for phase in ExcitationPhase},
        "AMB_CHECKSUM": Code.CHECKSUM,
    }
    checks = "".join(f"typedef char check_{number}[{name} == {int(value)} ? 1 : -1];\n"
                     for number, (name, value) in enumerate(names.items()))  # fmt: skip
    (tmp_path / "numbers.c").write_text(f'#include "amb_target.h"\n{checks}')
    subprocess.run(["gcc", "-std=c99", f"-I{SOURCE}", "-c", tmp_path / "numbers.c", "-o", tmp_path / "o"], check=True)


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(TargetError, match="no C code"):
        build_library(tmp_path / "target.so", source=tmp_path)


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    program = tmp_path_factory.mktemp("posix") / "amb_target"
    sources = [*SOURCE.glob("*.c"), SOURCE / "posix" / "main.c"]
    subprocess.run([*COMPILER, "-O2", "-o", program, *sources, "-lm"], check=True)
    return program


@pytest.fixture(scope="module")
def port(program: Path):
    """UDP port of a target with a rotor, in a process of its own."""
    key = program.with_name("key")
    key.write_text(KEY.hex())
    process = subprocess.Popen([program, "0", key], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    yield int(process.stdout.readline())
    process.kill()
    process.wait()
    process.stdout.close()


def test_a_rotor_levitates_over_udp(port: int) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.connect(("127.0.0.1", port))
        link.settimeout(5.0)
        link.send(hello())
        decoded = decode(link.recv(2000))
        assert isinstance(decoded, Description)
        assert machine_of([decoded]).axis_names == ("x", "y")
        session = decoded.session(KEY)
        writer = CommandWriter(session, decoded.counter)

        def answer(command) -> Reply:
            link.send(writer.write(command))
            while not isinstance(reply := decode(link.recv(2000), session), Reply):
                assert not isinstance(reply, Refusal)
            return reply

        def measured_after(step: int) -> TelemetryBlock:
            while not isinstance(block := decode(link.recv(2000), session), TelemetryBlock) or block.first_step <= step:
                pass
            return block

        def lifted_off() -> bool:
            """Until the rotor is at its reference; False if a loaded machine let the target miss too many steps."""
            reply = answer(commands.levitate(0.05))
            assert reply.code == Code.DONE
            while True:
                block = measured_after(reply.status.step)
                state = TargetState(int(block.status[-1]) & 0b111)
                if state == TargetState.TRIPPED:
                    return False
                if state == TargetState.LEVITATED and abs(block.position).max() < 1e-7:
                    return True

        assert answer(commands.stream(10, TelemetryOption.STATUS)).code == Code.DONE
        while not (lifted_off() and answer(commands.delevitate()).code == Code.DONE):
            reply = answer(commands.fault_reset())
            assert reply.code == Code.DONE
            measured_after(reply.status.step)  # until then it does not levitate


@pytest.mark.parametrize("text", ["00112233445566778899aabbccddee", "secret", "", KEY.hex() * 5, KEY.hex() + "x"])
def test_the_posix_target_refuses_a_wrong_key_and_shows_none_of_it(port: int, program: Path, text: str) -> None:
    key = program.with_name("wrong_key")
    key.write_text(text)
    ended = subprocess.run([program, "0", key], capture_output=True, text=True, timeout=60)
    assert (ended.returncode, "allowed: 16 to 64 bytes" in ended.stderr) == (1, True)
    assert not text or text not in ended.stderr + ended.stdout


def test_the_posix_target_listens_on_loopback_only_with_a_key_too(port: int) -> None:
    def listening(table: str) -> set[str]:
        rows = [line.split()[1] for line in Path(table).read_text().splitlines()[1:]]
        return {row.split(":")[0] for row in rows if int(row.split(":")[1], 16) == port}

    assert listening("/proc/net/udp") == {"0100007F"}
