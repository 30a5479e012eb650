import json

import pytest

from dgl_files.whole import (
    PARTIAL_MARK,
    append_line,
    compute_checksum,
    describe_access_fault,
    drop_unfinished_line,
    write_bytes,
    write_json,
    write_text,
    written_beside,
)


def test_a_file_appears_whole_and_alone(tmp_path):
    path = tmp_path / "new" / "picture.png"
    with written_beside(path) as partial:
        assert partial.suffix == ".png"
        assert partial.name.startswith(".")
        assert PARTIAL_MARK in partial.name
        partial.write_bytes(b"content")
        assert not path.exists()
    assert list(path.parent.iterdir()) == [path]
    assert path.read_bytes() == b"content"


def test_two_writers_of_one_file_do_not_meet(tmp_path):
    path = tmp_path / "a.txt"
    with written_beside(path) as first, written_beside(path) as second:
        assert first != second
        first.write_text("first")
        second.write_text("second")
    assert path.read_text() == "first"


def test_a_failure_leaves_the_old_file(tmp_path):
    path = tmp_path / "a.json"
    write_json(path, {"a": 1})
    with pytest.raises(ValueError, match="JSON compliant"):
        write_json(path, {"a": float("nan")})
    with pytest.raises(ZeroDivisionError), written_beside(path) as partial:
        partial.write_text(str(1 / 0))
    assert json.loads(path.read_text()) == {"a": 1}
    assert list(tmp_path.iterdir()) == [path]


def test_text_is_utf8_and_a_checksum_is_sha256(tmp_path):
    write_text(tmp_path / "a", "é\n")
    assert (tmp_path / "a").read_bytes() == b"\xc3\xa9\n"
    write_bytes(tmp_path / "b", b"abc")
    assert compute_checksum(tmp_path / "b").startswith("ba7816bf8f01cfea414140de5dae2223")


def test_lines_are_whole(tmp_path):
    path = tmp_path / "log.jsonl"
    drop_unfinished_line(path)  # A missing file has none.
    append_line(path, "one")
    with path.open("a") as file:
        file.write("tw")
    drop_unfinished_line(path)
    append_line(path, "two")
    assert path.read_text() == "one\ntwo\n"


def test_a_file_that_cannot_be_opened_now_is_told_from_a_damaged_one():
    assert "permission denied" in str(describe_access_fault(PermissionError(13, "denied")))
    assert "has locked it" in str(describe_access_fault(BlockingIOError(11, "unable to lock")))
    assert "for writing" in str(describe_access_fault(OSError("file is already open for write")))
    for err in (OSError("truncated file"), FileNotFoundError(2, "none"), ValueError("no number")):
        assert describe_access_fault(err) is None
