"""Records are whole or not there; two writers never meet; a full disk is one line."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from occ.errors import InputError
from occ.experiment.journal import Journal

CONTENTS = {"a": b"first\nline", "b": b"", "c": bytes(range(256)) * 40}


def written(folder: Path) -> Path:
    with Journal(folder) as journal:
        for key, content in CONTENTS.items():
            journal.write(key, content)
    (path,) = folder.glob("*.journal")
    return path


def test_records_come_back(tmp_path: Path) -> None:
    written(tmp_path)
    journal = Journal(tmp_path)
    assert {key: journal.read(key) for key in CONTENTS} == CONTENTS
    assert "a" in journal
    assert "d" not in journal
    assert journal.read("d") is None


def test_wherever_the_writer_was_killed_only_whole_records_are_read(tmp_path: Path) -> None:
    path = written(tmp_path)
    content = path.read_bytes()
    ends = [content.index(part) + len(part) for part in (CONTENTS["a"], CONTENTS["c"])]
    for size in [0, 1, 30, *range(ends[0] - 3, ends[0] + 3), ends[1] - 1, ends[1]]:
        path.write_bytes(content[:size])
        with Journal(tmp_path) as journal:
            found = {key: journal.read(key) for key in CONTENTS if key in journal}
        assert found.items() <= CONTENTS.items()
        assert ("a" in found) == (size >= ends[0])
        assert ("c" in found) == (size >= ends[1])


def test_damaged_content_is_not_believed_and_what_follows_is(tmp_path: Path) -> None:
    path = written(tmp_path)
    path.write_bytes(path.read_bytes().replace(b"first", b"fIrst"))
    journal = Journal(tmp_path)
    assert journal.read("a") is None
    assert journal.read("c") == CONTENTS["c"]


def test_two_writers_at_once(tmp_path: Path) -> None:
    with Journal(tmp_path) as one, Journal(tmp_path) as other:
        for number in range(5):
            one.write(f"one{number}", b"1")
            other.write(f"other{number}", b"2")
        one.write("both", b"the same")
        other.write("both", b"the same")
    both = Journal(tmp_path)
    assert [both.read(f"{name}{i}") for name in ("one", "other") for i in range(5)] == [b"1"] * 5 + [b"2"] * 5
    assert both.read("both") == b"the same"


def test_full_disk_is_one_line_and_loses_nothing(tmp_path: Path) -> None:
    class Full:
        """A file on a disk that is full after ten bytes."""

        def __init__(self, file: object) -> None:
            self.file = file

        def write(self, content: bytes) -> None:
            self.file.write(content[:10])
            self.file.flush()
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        def __getattr__(self, name: str) -> object:
            return getattr(self.file, name)

    with Journal(tmp_path) as journal:
        journal.write("a", CONTENTS["a"])
        journal._file = Full(journal._file)
        with pytest.raises(InputError, match="No space left on device") as caught:
            journal.write("b", CONTENTS["c"])
    assert "\n" not in str(caught.value)
    again = Journal(tmp_path)
    assert again.read("a") == CONTENTS["a"]
    assert "b" not in again


def test_folder_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(InputError, match="cannot be written"):
        Journal(tmp_path / "taken")
