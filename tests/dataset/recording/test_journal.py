from __future__ import annotations

import errno
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.dataset.recording.journal import Journal, JournalReader, JournalWriter, read_journal

COLUMNS = ("time", "record", "position")
PART = 1 << 18  #: bytes that are searched for a marker at a time
rows = st.lists(st.tuples(*[st.floats(width=64)] * 3), max_size=40)


def content(found: Journal) -> np.ndarray:
    blocks = list(found.blocks(3))
    return np.concatenate(blocks) if blocks else np.empty((0, 3))


@given(parts=st.lists(rows, max_size=6), in_blocks=st.booleans())
@settings(max_examples=60)
def test_flushed_rows_are_read_back_bit_for_bit(
    tmp_path_factory: pytest.TempPathFactory, parts: list, in_blocks: bool
) -> None:
    path = tmp_path_factory.mktemp("journal") / "samples.journal"
    writer = JournalWriter(path, COLUMNS, {"session": 0})
    for part in parts:
        if in_blocks:
            writer.append_block(np.array(part, dtype=float).reshape(-1, 3))
        else:
            for row in part:
                writer.append(row)
        writer.flush()
    writer.close()
    found = read_journal(path)
    assert found.facts == {"session": 0, "columns": list(COLUMNS)}
    assert found.lost_bytes == 0
    expected = np.array([row for part in parts for row in part], dtype=float).reshape(-1, 3)
    assert found.rows(3) == len(expected)
    assert not found.damaged
    assert content(found).tobytes() == expected.tobytes()


def test_truncation_at_any_byte_keeps_every_complete_frame(tmp_path: Path) -> None:
    path = tmp_path / "samples.journal"
    writer = JournalWriter(path, COLUMNS, {"session": 0})
    ends, expected = [path.stat().st_size], []
    for frame in range(5):
        for row in range(frame + 1):
            expected.append((float(frame), row, 0.5))
            writer.append(expected[-1])
        writer.flush()
        ends.append(path.stat().st_size)
    writer.close()
    whole = path.read_bytes()
    counts = np.cumsum([0, 1, 2, 3, 4, 5])
    cut = tmp_path / "cut.journal"
    for length in range(len(whole) + 1):
        cut.write_bytes(whole[:length])
        found = read_journal(cut)
        if length < ends[0]:
            assert (found.facts, found.frames, found.damaged) == (None, (), True)
            continue
        frames = sum(end <= length for end in ends) - 1
        assert content(found).tolist() == [list(row) for row in expected[: counts[frames]]]
        assert found.lost_bytes == length - ends[frames]


@pytest.mark.parametrize("tail", [b"\0" * 512, b"\xff" * 512, b"garbage"])
def test_garbage_left_at_the_end_by_a_power_failure_is_ignored(tmp_path: Path, tail: bytes) -> None:
    path = tmp_path / "samples.journal"
    writer = JournalWriter(path, COLUMNS, {})
    writer.append((1.0, 2.0, 3.0))
    writer.flush()
    writer.close()
    path.write_bytes(path.read_bytes() + tail)
    found = read_journal(path)
    assert content(found).tolist() == [[1.0, 2.0, 3.0]]
    assert found.lost_bytes == len(tail)


def test_a_flipped_bit_loses_only_its_own_frame(tmp_path: Path) -> None:
    path = tmp_path / "samples.journal"
    writer = JournalWriter(path, COLUMNS, {"session": 0})
    begins = []
    for row in range(4):
        begins.append(path.stat().st_size)
        writer.append((row, row, row))
        writer.flush()
    writer.close()
    whole = path.read_bytes()
    for place in range(len(whole)):
        damaged = bytearray(whole)
        damaged[place] ^= 0x10
        path.write_bytes(damaged)
        found = read_journal(path)
        hit = sum(begin <= place for begin in begins) - 1
        kept = [row for row in range(4) if row != hit]
        assert content(found).tolist() == [[row] * 3 for row in kept]
        assert found.lost_rows(3) == (1 if 0 <= hit < 3 else 0), "what is behind the last frame is not known"
        assert found.damaged
        assert (found.facts is None) == (8 <= place < begins[0])


@given(data=st.data())
@settings(max_examples=150)
def test_random_damage_never_invents_nor_reorders_rows(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    """Bytes overwritten, removed, inserted or zeroed: the rows read are rows that were written, in order."""
    path = tmp_path_factory.mktemp("journal") / "samples.journal"
    writer = JournalWriter(path, COLUMNS, {"session": 0})
    for row in range(30):
        writer.append((row, row, row))
        if row % 3 == 0:
            writer.flush()
    writer.flush()
    writer.close()
    content_now = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(content_now) - 1))
        size = data.draw(st.integers(1, 120))
        kind = data.draw(st.sampled_from(("zero", "cut", "put in", "repeat")))
        stretch = bytes(content_now[at : at + size])
        if kind == "zero":
            content_now[at : at + size] = bytes(len(stretch))
        elif kind == "cut":
            del content_now[at : at + size]
        else:
            content_now[at:at] = stretch if kind == "repeat" else data.draw(st.binary(max_size=size))
        if not content_now:
            break
    path.write_bytes(content_now)
    found = read_journal(path)
    times = content(found)[:, 0].tolist()
    assert times == sorted(set(times))
    assert set(times) <= set(range(30))


@pytest.mark.parametrize("damage", [0, 1, 7, PART - 9, *range(PART - 8, PART + 2), 2 * PART - 8])
def test_a_frame_is_found_wherever_the_damage_before_it_ends(tmp_path: Path, damage: int) -> None:
    """A damaged stretch is searched in parts, and the marker behind it may lie across the end of one."""
    path = tmp_path / "samples.journal"
    writer = JournalWriter(path, COLUMNS, {})
    begin = path.stat().st_size
    for row in range(2):
        writer.append((row, row, row))
        writer.flush()
    writer.close()
    whole = path.read_bytes()
    path.write_bytes(whole[:begin] + bytes(damage) + whole[begin:])
    found = read_journal(path)
    assert content(found)[:, 0].tolist() == [0.0, 1.0]
    assert (found.lost_bytes, found.damaged) == (damage, damage > 0)
    late = JournalReader(path)
    assert len(late.poll()) == 2
    late.close()


def test_blocks_do_not_depend_on_when_rows_were_flushed(tmp_path: Path) -> None:
    sizes = []
    for name, every in (("a", 7), ("b", 100)):
        writer = JournalWriter(tmp_path / name, COLUMNS, {})
        for row in range(250):
            writer.append((row, 0, 0))
            if row % every == 0:
                writer.flush()
        writer.flush()
        writer.close()
        found = read_journal(tmp_path / name)
        sizes.append([len(block) for block in found.blocks(3, 64)])
    assert sizes == [[64, 64, 64, 58]] * 2


class FullDisk:
    """A file on a nearly full disk: accepts part of a write, then nothing."""

    def __init__(self, file: object, room: int) -> None:
        self._file, self.room = file, room

    def write(self, data: bytes) -> int:
        if self.room == 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        with memoryview(data) as view:
            taken = self._file.write(view[: self.room])  # type: ignore[attr-defined]
        self.room -= taken
        return int(taken)

    def __getattr__(self, name: str) -> object:
        return getattr(self._file, name)


@pytest.mark.parametrize("room", [0, 3, 8, 20, 33, 60, 79])
def test_a_full_disk_truncates_no_frame_and_loses_no_row(tmp_path: Path, room: int) -> None:
    path = tmp_path / "samples.journal"
    writer = JournalWriter(path, COLUMNS, {})
    writer.append((0, 0, 0))
    writer.flush()
    disk = FullDisk(writer._file, room)
    writer._file = disk  # type: ignore[assignment]
    writer.append((1, 1, 1))
    writer.append((2, 2, 2))
    if room < 80:
        with pytest.raises(OSError, match="No space left"):
            writer.flush()
        found = read_journal(path)
        assert (content(found).tolist(), found.lost_bytes) == ([[0, 0, 0]], 0)
        disk.room = 1000
    writer.flush()
    assert content(read_journal(path)).tolist() == [[0, 0, 0], [1, 1, 1], [2, 2, 2]]
    writer.close()


def test_an_existing_journal_is_never_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "samples.journal"
    path.write_bytes(b"precious")
    with pytest.raises(FileExistsError):
        JournalWriter(path, COLUMNS, {})
    assert path.read_bytes() == b"precious"


def test_a_block_of_the_wrong_width_is_refused(tmp_path: Path) -> None:
    writer = JournalWriter(tmp_path / "samples.journal", COLUMNS, {})
    with pytest.raises(ValueError, match="3 columns"):
        writer.append_block(np.zeros((2, 4)))
    writer.close()


def test_a_journal_of_an_earlier_version_is_read(tmp_path: Path) -> None:
    """Its frames: length and CRC-32, then the payload; the first is JSON."""
    path = tmp_path / "samples.journal"
    facts = b'{"session": 0, "offset": 0.0, "columns": ["time", "record", "position"]}'
    rows = [np.array([[row, 0.0, 1.0]]).tobytes() for row in range(3)]
    frames = [struct.pack("<II", len(one), zlib.crc32(one)) + one for one in (facts, *rows)]
    path.write_bytes(b"RIGJRNL1" + b"".join(frames) + b"torn")
    found = read_journal(path)
    assert content(found)[:, 0].tolist() == [0.0, 1.0, 2.0]
    assert (found.lost_bytes, found.lost_rows(3)) == (4, 0)
    assert found.facts is not None


def test_a_reader_follows_a_writer_row_by_row_and_skips_what_is_damaged(tmp_path: Path) -> None:
    path = tmp_path / "samples.journal"
    reader = JournalReader(path)
    assert reader.poll() == []  # the journal need not exist yet
    writer = JournalWriter(path, ["time", "x"], {"offset": 3.0})
    assert reader.poll() == []
    assert reader.facts is not None
    assert reader.facts["offset"] == 3.0
    seen: list[float] = []

    def times(found: list[bytes]) -> list[float]:
        return [time for payload in found for time, _ in struct.iter_unpack("<2d", payload)]

    for row in range(50):
        writer.append((float(row), 0.5))
        writer.flush()
        if row % 7 == 0:
            seen += times(reader.poll())
    assert seen + times(reader.poll()) == [float(row) for row in range(50)]
    writer.close()
    reader.close()
    whole = bytearray(path.read_bytes())
    frame = len(whole) - whole.rindex(b"\xa7RGJ")
    whole[-frame - 3] ^= 0xFF  # in the payload of the last frame but one
    path.write_bytes(whole[:-5])  # and the last frame is still being written
    late = JournalReader(path, most=10 * frame)
    assert times(late.poll()) == [float(row) for row in range(40, 48)]
    path.write_bytes(whole)
    assert times(late.poll()) == [49.0]
    late.close()
