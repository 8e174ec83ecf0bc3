"""The file with the key of a target."""

from __future__ import annotations

from pathlib import Path

import pytest

from amb_core.ground.errors import TargetError
from amb_core.rig.link.key_file import read_key

KEY = bytes(range(32))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "key"
    path.write_text(KEY.hex() + "\n")
    path.chmod(0o600)
    return path


def test_the_key_is_read(file: Path) -> None:
    assert read_key(file) == KEY


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o660, 0o644])
def test_a_key_that_others_can_read_is_refused(file: Path, mode: int) -> None:
    file.chmod(mode)
    with pytest.raises(TargetError, match=rf"has mode {mode:04o}; allowed: 0600 \(run: chmod 600"):
        read_key(file)


@pytest.mark.parametrize(
    ("content", "reason"),
    [("", "is empty"), ("no key", "is not in hexadecimal digits"), ("abcd", "has 2 bytes; allowed: 16 to 64")],
)
def test_what_is_no_key_is_refused(file: Path, content: str, reason: str) -> None:
    file.write_text(content)
    with pytest.raises(TargetError, match=f"key file .*: .*{reason}"):
        read_key(file)


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    for path in (tmp_path / "missing", tmp_path):
        with pytest.raises(TargetError, match=r"key file .*: cannot be read"):
            read_key(path)
