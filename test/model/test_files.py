# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Reading and writing of whole files: only plain files of limited size are read, and a failure leaves nothing."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any

import pytest

from posfet_model import files
from posfet_model.files import read_bytes, read_text, write_text


def test_a_file_up_to_the_limit_is_read(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"x" * 100)
    assert read_bytes(path, 100) == b"x" * 100
    path.write_bytes(b"\xef\xbb\xbf\xc3\xbc\n")
    assert read_text(str(path), 100) == "\u00fc\n"


def make_fifo(folder: Path) -> Path:
    os.mkfifo(folder / "pipe")
    return folder / "pipe"


def make_sparse(folder: Path) -> Path:
    path = folder / "sparse"
    with path.open("wb") as stream:
        stream.truncate(2 << 30)
    return path


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (make_fifo, "not a regular file"),
        (make_sparse, "larger than 1 kB"),
        (lambda _: "/dev/zero", "not a regular file"),
        (lambda folder: folder, "Is a directory"),
        (lambda folder: folder / "none", "No such file or directory"),
        (lambda folder: folder / ("x" * 300), "File name too long"),
        (lambda _: "a\0b", "not a file name"),
        (lambda _: "\ud800", "not a file name"),
    ],
)
def test_what_is_no_plain_file_is_refused_at_once(tmp_path: Path, make: Any, reason: str) -> None:
    with pytest.raises(OSError, match=reason) as caught:
        read_bytes(make(tmp_path), 1000)
    assert caught.value.strerror == reason


def test_a_file_that_grows_while_it_is_read_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "growing"
    path.write_bytes(b"x" * 10)
    check = files._check_regular

    def check_and_append(status: os.stat_result, limit: int) -> None:
        check(status, limit)
        with path.open("ab") as stream:
            stream.write(b"x" * 600)

    monkeypatch.setattr(files, "_check_regular", check_and_append)
    with pytest.raises(OSError, match="larger than 1 kB"):
        read_bytes(path, 1000)


def test_bytes_that_are_no_text_are_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"\xff")
    with pytest.raises(OSError, match="is not UTF-8 text"):
        read_text(tmp_path / "file", 100)


def test_a_file_is_written_or_replaced(tmp_path: Path) -> None:
    path = tmp_path / ("x" * 250 + ".yaml")  # the longest name that there is
    for text in ("first", "\u00fc"):
        write_text(path, text)
        assert path.read_text(encoding="utf-8") == text
    assert list(tmp_path.iterdir()) == [path]


def test_symbolic_links_are_replaced_and_never_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    victim = tmp_path / "victim"
    victim.write_text("precious")
    (tmp_path / "cal.yaml").symlink_to(victim)
    write_text(tmp_path / "cal.yaml", "new")
    assert not (tmp_path / "cal.yaml").is_symlink()
    monkeypatch.setattr(files.os, "urandom", lambda _: b"known")  # as if the name could be predicted
    (tmp_path / f".posfet-{b'known'.hex()}.part").symlink_to(victim)
    with pytest.raises(FileExistsError):
        write_text(tmp_path / "cal.yaml", "newer")
    assert victim.read_text() == "precious"
    assert (tmp_path / "cal.yaml").read_text() == "new"


def test_a_device_is_not_replaced(tmp_path: Path) -> None:
    link = tmp_path / "out.csv"
    link.symlink_to(os.devnull)
    with pytest.raises(OSError, match="not a regular file"):
        write_text(link, "new")
    assert list(tmp_path.iterdir()) == [link] and link.is_symlink()


@pytest.mark.parametrize("failing", ["fsync", "replace"])
def test_nothing_is_left_when_writing_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failing: str) -> None:
    path = tmp_path / "cal.yaml"
    path.write_text("old")

    def full(*_: Any, **__: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(files.os, failing, full)
    with pytest.raises(OSError, match="No space left on device"):
        write_text(path, "new")
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_text() == "old"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs the device that is always full")
def test_nothing_is_left_on_a_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened = os.open

    def open_full(name: Any, flags: int, mode: int = 0o777, *, dir_fd: int | None = None) -> int:
        descriptor = opened(name, flags, mode, dir_fd=dir_fd)
        if flags & os.O_CREAT:
            os.dup2(full := opened("/dev/full", os.O_WRONLY), descriptor)
            os.close(full)
        return descriptor

    monkeypatch.setattr(files.os, "open", open_full)
    with pytest.raises(OSError, match="No space left on device"):
        write_text(tmp_path / "cal.yaml", "new")
    assert not list(tmp_path.iterdir())


def test_a_fifo_in_place_of_a_file_is_replaced_and_does_not_block(tmp_path: Path) -> None:
    make_fifo(tmp_path)
    write_text(tmp_path / "pipe", "text")
    assert (tmp_path / "pipe").read_text() == "text"


def test_a_missing_folder_or_a_name_that_is_none_is_refused(tmp_path: Path) -> None:
    for path, reason in ((tmp_path / "no" / "file", "No such file"), ("a\0/b", "not a file name")):
        with pytest.raises(OSError, match=reason):
            write_text(path, "text")
