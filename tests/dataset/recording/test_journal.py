from __future__ import annotations

import errno
import os
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.dataset.recording import journal
from rigctl.dataset.recording.journal import MAGIC, Journal, JournalReader, JournalWriter, read_journal
from rigctl.errors import ExitCode, RigctlError

COLUMNS = ("time", "record", "position")
PART = 1 << 18  #: bytes that are searched for a marker at a time
rows = st.lists(st.tuples(*[st.floats(width=64)] * 3), max_size=40)


def content(found: Journal) -> np.ndarray:
    blocks = list(found.blocks(3, 1 << 17))
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
            assert found.lost_bytes == (length - 8 if length >= 8 else length)
            assert found.lost_rows(3) == 0
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
    assert [len(block) for block in found.blocks(3, 125)] == [125, 125], "no empty block follows"


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


@pytest.mark.parametrize("shape", [(2, 4), (3,), (3, 3, 1), (1, 3, 3)])
def test_a_block_of_the_wrong_shape_is_refused(tmp_path: Path, shape: tuple[int, ...]) -> None:
    writer = JournalWriter(tmp_path / "samples.journal", COLUMNS, {})
    with pytest.raises(ValueError, match="3 columns"):
        writer.append_block(np.zeros(shape))
    writer.append_block(np.zeros((2, 3)))
    writer.append_block(np.zeros((0, 3)))
    writer.flush()
    writer.close()
    assert len(content(read_journal(writer.path))) == 2
    with pytest.raises(ValueError, match="closed"):
        writer.sync()


def test_one_flipped_bit_in_a_long_block_loses_a_quarter_of_a_megabyte_at_most(tmp_path: Path) -> None:
    """Rows are divided among frames, each of whole rows."""
    path = tmp_path / "samples.journal"
    writer = JournalWriter(path, COLUMNS, {})
    begin = path.stat().st_size
    writer.append_block(np.repeat(np.arange(40_000.0), 3).reshape(-1, 3))
    writer.flush()
    writer.close()
    damaged = bytearray(path.read_bytes())
    damaged[begin + 300_000] ^= 1
    path.write_bytes(damaged)
    found = read_journal(path)
    lost = found.lost_rows(3)
    assert 0 < 24 * lost <= 1 << 18
    kept = content(found)
    assert np.array_equal(np.setdiff1d(np.arange(40_000.0), kept[:, 0]), lost + np.arange(float(lost)))
    assert np.array_equal(kept[:, 0], kept[:, 2])


def joined(*frames: bytes, magic: bytes = MAGIC) -> bytes:
    """A journal of these payloads, the first of which is the facts; by the layout in the module's text."""
    parts = [magic]
    for number, payload in enumerate(frames):
        if magic == b"RIGJRNL1":
            head = struct.pack("<II", len(payload), zlib.crc32(payload))
        else:
            head = struct.pack("<8sIQII", b"\xa7RGJ\x1eF\x95\n", number, 0, len(payload), zlib.crc32(payload))
            head += struct.pack("<I", zlib.crc32(head))
        parts += [head, payload]
    return b"".join(parts)


@pytest.mark.parametrize("magic", [MAGIC, b"RIGJRNL1"])
def test_a_frame_longer_than_any_is_damage(tmp_path: Path, magic: bytes) -> None:
    """A length that was damaged, or forged, must not be read into memory."""
    path = tmp_path / "samples.journal"
    facts = b'{"columns": ["time", "record"]}'
    longest = bytes(1 << 24)
    path.write_bytes(joined(facts, longest, magic=magic))
    assert (read_journal(path).rows(2), read_journal(path).damaged) == (1 << 20, False)
    path.write_bytes(joined(facts, longest + bytes(16), magic=magic))
    assert (read_journal(path).rows(2), read_journal(path).damaged) == (0, True)


def test_a_frame_that_is_there_twice_is_read_once(tmp_path: Path) -> None:
    """A file system that repeats a stretch after a power failure must not repeat samples."""
    path = tmp_path / "samples.journal"
    writer = JournalWriter(path, COLUMNS, {})
    ends = [path.stat().st_size]
    for row in range(3):
        writer.append((row, row, row))
        writer.flush()
        ends.append(path.stat().st_size)
    writer.close()
    whole = path.read_bytes()
    for first, last in ((2, 3), (0, 3), (0, 1), (1, 2)):
        path.write_bytes(whole + whole[ends[first] : ends[last]])
        assert content(read_journal(path))[:, 0].tolist() == [0.0, 1.0, 2.0]


def test_a_journal_that_is_not_there_is_reported(tmp_path: Path) -> None:
    with pytest.raises(RigctlError, match="cannot read the journal") as caught:
        read_journal(tmp_path / "samples.journal")
    assert caught.value.exit_code is ExitCode.FAILED


class Reluctant:
    """A file that takes a few bytes of each write, and after `room` bytes none."""

    def __init__(self, file: object, room: int) -> None:
        self._file, self._room = file, room

    def write(self, data: bytes) -> int:
        taken = min(7, self._room, len(data))
        self._room -= taken
        with memoryview(data) as view:
            self._file.write(view[:taken])  # type: ignore[attr-defined]
        return taken

    def __getattr__(self, name: str) -> object:
        return getattr(self._file, name)


def test_what_is_accepted_in_parts_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "samples.journal"
    writer = JournalWriter(path, COLUMNS, {})
    file = writer._file
    writer.append((1.0, 2.0, 3.0))
    writer._file = Reluctant(file, 40)  # type: ignore[assignment]
    with pytest.raises(OSError, match="no bytes could be written"):
        writer.flush()
    assert content(read_journal(path)).tolist() == []
    writer._file = Reluctant(file, 1000)  # type: ignore[assignment]
    writer.flush()
    writer.close()
    found = read_journal(path)
    assert (content(found).tolist(), found.lost_bytes) == ([[1.0, 2.0, 3.0]], 0)


class Gone:
    """A file whose disk has been unplugged."""

    def __init__(self, file: object) -> None:
        self._file = file

    def seek(self, *_: int) -> int:
        raise OSError(errno.EIO, "Input/output error")

    def __getattr__(self, name: str) -> object:
        return getattr(self._file, name)


@pytest.mark.parametrize(
    ("read_back", "gone", "kept"),
    [(True, False, [0.0, 1.0, 2.0]), (False, False, [1.0, 2.0]), (True, True, [1.0, 2.0])],
)
def test_another_journal_continues_one_whose_folder_is_gone(
    tmp_path: Path, read_back: bool, gone: bool, kept: list[float]
) -> None:
    """With all its rows, or with those that were still buffered if the disk does not answer."""
    first = JournalWriter(tmp_path / "first", COLUMNS, {"session": 3})
    assert first.in_place()
    first.append((0.0, 0.0, 0.0))
    first.flush()
    first.append((1.0, 1.0, 1.0))
    file = first._file
    if gone:
        first._file = Gone(file)  # type: ignore[assignment]
    if os.name != "nt":  # where an open file cannot be moved
        (tmp_path / "first").rename(tmp_path / "moved")
        assert not first.in_place()
    second = JournalWriter(tmp_path / "second", COLUMNS, {"session": 3, "of": "a longer first frame"})
    second.take_over(first, read_back=read_back)
    second.append((2.0, 2.0, 2.0))
    whole = (tmp_path / "second").stat().st_size
    real = second._file
    second._file = FullDisk(real, 50)  # type: ignore[assignment]
    with pytest.raises(OSError, match="No space left"):
        second.flush()
    assert (tmp_path / "second").stat().st_size == whole, "a frame that has no room leaves nothing behind"
    second._file = real
    second.flush()
    for one, used in ((first, file), (second, real)):
        one.close()
        used.close()
    found = read_journal(tmp_path / "second")
    assert content(found)[:, 0].tolist() == kept
    assert found.lost_bytes == 0
    assert found.lost_rows(3) == 3 - len(kept), "those that it could not take over are counted"


def test_an_earlier_version_s_journal_ends_at_its_first_damage(tmp_path: Path) -> None:
    path = tmp_path / "samples.journal"
    facts = b'{"session": 0, "columns": ["time", "record", "position"]}'
    whole = joined(facts, *(np.full((1, 3), float(row)).tobytes() for row in range(3)), magic=b"RIGJRNL1")
    begin = 8 + 8 + len(facts)
    for place in range(8, len(whole)):
        damaged = bytearray(whole)
        damaged[place] ^= 0x10
        path.write_bytes(damaged)
        found = read_journal(path)
        frames = max((place - begin) // 32, 0)
        assert content(found)[:, 0].tolist() == list(range(frames))
        assert (found.facts is None) == (place < begin)
        assert found.lost_bytes == (len(whole) - 8 if place < begin else len(whole) - begin - 32 * frames)
    path.write_bytes(whole + bytes(800))
    assert len(content(read_journal(path))) == 3
    assert read_journal(path).lost_bytes == 800, "zeros left by a power failure are no frames"


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


def seen_by(reader: JournalReader, **most: int) -> list[float]:
    """Times of three columns."""
    return [time for payload in reader.poll(**most) for time, _, _ in struct.iter_unpack("<3d", payload)]


@pytest.mark.parametrize("many", [1, 2, 3])
def test_a_reader_goes_on_behind_several_damaged_frames(tmp_path: Path, many: int) -> None:
    """Two in a row used to stop the live view for the rest of the run."""
    path = tmp_path / "samples.journal"
    writer = JournalWriter(path, COLUMNS, {})
    for row in range(6):
        writer.append((row, row, row))
        writer.flush()
    writer.close()
    damaged = bytearray(path.read_bytes())
    for frame in read_journal(path).frames[1 : 1 + many]:
        damaged[frame.start] ^= 1
    path.write_bytes(damaged)
    reader = JournalReader(path)
    assert seen_by(reader) == [0.0, *range(1 + many, 6)]
    assert seen_by(reader) == []
    reader.close()


def test_a_reader_follows_a_resumed_run_from_its_start(tmp_path: Path) -> None:
    """Its journal is a new file at the same place; between the two there is none."""
    path = tmp_path / "samples.journal"
    reader = JournalReader(path)
    reader.close()
    for session in range(3):
        writer = JournalWriter(path, COLUMNS, {"session": session})
        for row in range(3 - session):
            writer.append((10.0 * session + row, 0.0, 0.0))
            writer.flush()
        assert seen_by(reader) == [10.0 * session + row for row in range(3 - session)]
        assert reader.facts is not None
        assert reader.facts["session"] == session
        writer.close()
        if os.name == "nt":
            reader.close()  # where an open file can be neither removed nor replaced
        path.unlink()
        if session == 0:
            assert reader.poll() == []
            assert reader.facts is None, "nothing is known of a run that is gone"
    reader.close()
    reader.close()


def test_a_reader_waits_for_the_first_frame_and_believes_no_other_file(tmp_path: Path) -> None:
    path = tmp_path / "samples.journal"
    writer = JournalWriter(path, COLUMNS, {"session": 7})
    first = path.stat().st_size
    writer.append((1.0, 2.0, 3.0))
    writer.flush()
    writer.close()
    whole = path.read_bytes()
    reader = JournalReader(path)
    others = [b"RIGJRNL1" + whole[8:], b"RIGJRNL2" + whole[first:], *(whole[:end] for end in range(first))]
    for other in others:
        path.write_bytes(other)
        assert reader.poll() == []
        assert reader.facts is None
    path.write_bytes(whole)
    assert seen_by(reader) == [1.0]
    assert reader.facts == {"session": 7, "columns": list(COLUMNS)}
    reader.close()


def test_a_reader_survives_a_disk_that_fails_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "samples.journal"
    writer = JournalWriter(path, COLUMNS, {"session": 7})
    writer.append((1.0, 2.0, 3.0))
    writer.flush()
    writer.close()

    def fail(*_: object) -> None:
        raise OSError(errno.EIO, "Input/output error")

    reader = JournalReader(path)
    with monkeypatch.context() as failing:
        failing.setattr(journal, "_read_frame", fail)
        assert reader.poll() == []
    assert seen_by(reader) == [1.0]
    reader.close()


def test_a_reader_that_comes_late_reads_the_last_megabytes_a_part_at_a_time(tmp_path: Path) -> None:
    path = tmp_path / "samples.journal"
    writer = JournalWriter(path, COLUMNS, {})
    writer.append_block(np.repeat(np.arange(500_000.0), 3).reshape(-1, 3))
    writer.flush()
    writer.close()
    reader = JournalReader(path)
    parts = [sum(map(len, reader.poll())) for _ in range(8)]
    assert 7 << 20 < sum(parts) <= 8 << 20
    assert all(2 << 20 <= part < (2 << 20) + (1 << 18) for part in parts[:3])
    assert parts[-1] == 0
    reader.close()


@pytest.mark.parametrize(("most", "frames"), [(1, 1), (24, 1), (25, 2), (48, 2), (49, 3)])
def test_a_reader_takes_no_more_frames_than_were_asked_for(tmp_path: Path, most: int, frames: int) -> None:
    path = tmp_path / "samples.journal"
    writer = JournalWriter(path, COLUMNS, {})
    for row in range(5):
        writer.append((row, row, row))
        writer.flush()
    writer.close()
    reader = JournalReader(path)
    assert seen_by(reader, most=most) == list(range(frames))
    assert seen_by(reader) == list(range(frames, 5))
    reader.close()
