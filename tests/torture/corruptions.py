"""A run's files damaged at random: nothing is invented, lost outside the damage, or left unreported."""

from __future__ import annotations

import json
import random
import shutil
import struct
import zlib
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from rigctl.dataset import Condition, RunWriter, open_run, verify
from rigctl.dataset.recording.header import RunHeader, Source
from rigctl.errors import RigctlError
from rigctl.rig import Layout

LAYOUT = Layout(channels=("position",), commands=("valve",), units=("s", "1", "mm", "1"))
RECORDS, ROWS = 4, 30
#: bytes of a row: time, record, position, valve
_ROW = 32
#: the marker and the header of a frame, read here as the format's page describes them
_MARKER, _HEADER = b"\xa7RGJ\x1eF\x95\n", struct.Struct("<8sIQII")


@dataclass
class Tally:
    """What happened over all trials."""

    trials: int = 0
    lost_rows: int = 0
    lost_outside: int = 0
    conditions: dict[str, int] = field(default_factory=dict)


def make_unclosed(runs: Path) -> Path:
    """A run as a killed program leaves it: four records of thirty samples, flushed every seven."""
    header = RunHeader(
        id="20261121-093000-torture",
        procedure=Source("stroke", "procedure: stroke\n", path="p.yaml"),
        rig=Source("bench", "rig: bench\n", path="r.yaml"),
        layout=LAYOUT,
        started=datetime(2026, 11, 21, 9, 30, tzinfo=UTC),
        backend={"kind": "simulated"},
        operator="Ada",
        clock="virtual",
        seed=1,
        calibrations={},
    )
    writer = RunWriter.create(runs, header)
    for number in range(RECORDS):
        index = writer.open_record(number + 0.1, "stroke", {"supply": (30e5, "bar")}, str(number), 100.0)
        writer.event(number + 0.1, "command", actuator="valve", value=1.0, uncertainty=0.0)
        for row in range(ROWS):
            writer.append((number + 0.1 + row / 100, index, 1e-3 * (100 * number + row), 1.0))
            if row % 7 == 6:
                writer.flush()
        writer.close_record(number + 0.5, "complete")
    writer.flush()
    for part in (writer._journal, writer._log):
        part.close()
    writer._lock.release()
    return writer.folder


def damage(content: bytes, rng: random.Random) -> tuple[bytes, set[int]]:
    """Bytes changed at random, and which of the original bytes were hit."""
    changed = bytearray(content)
    at = rng.randrange(max(1, len(changed)))
    size = rng.choice((1, 1, 2, 8, 40, 200))
    kind = rng.choice(("bit", "bit", "zeros", "noise", "cut", "insert", "truncate", "empty"))
    if kind == "bit":
        changed[at] ^= 1 << rng.randrange(8)
        return bytes(changed), {at}
    if kind in ("zeros", "noise"):
        stretch = range(at, min(at + size, len(changed)))
        for place in stretch:
            changed[place] = 0 if kind == "zeros" else rng.randrange(256)
        return bytes(changed), set(stretch)
    if kind == "cut":
        return content[:at] + content[at + size :], set(range(at, min(at + size, len(content))))
    if kind == "insert":
        return content[:at] + rng.randbytes(size) + content[at:], {max(at - 1, 0), at}
    if kind == "truncate":
        return content[:at], set(range(at, len(content)))
    return b"", set(range(len(content)))


def rows_by_byte(content: bytes) -> list[tuple[int, int, range]]:
    """(first byte, end, rows) of every frame, by a reader that shares no code with the one that is tried."""
    found, at = [], 0
    while (at := content.find(_MARKER, at)) >= 0:
        _, number, first, length, checksum = _HEADER.unpack_from(content, at)
        begin = at + _HEADER.size + 4
        assert zlib.crc32(content[begin : begin + length]) == checksum
        if number:
            found.append((at, begin + length, range(first, first + length // _ROW)))
        at = begin + length
    return found


def corrupt_once(whole: Path, folder: Path, rng: random.Random, tally: Tally) -> None:
    """Damage one file of a copy of the run, recover it, and check everything that must hold.

    Raises
    ------
    AssertionError
        something was invented, lost outside the damage, or not reported.
    """
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(whole, folder)
    name = rng.choice(("samples.journal", "samples.journal", "log.jsonl", "run.json", "state.json"))
    path = folder / name
    original = path.read_bytes() if path.exists() else b""
    damaged, hit = damage(original, rng) if original else (rng.randbytes(40), set())
    path.write_bytes(damaged)
    verdict = verify(folder)
    tally.trials += 1
    tally.conditions[verdict.condition.value] = tally.conditions.get(verdict.condition.value, 0) + 1
    kept = [entry.read_bytes() for entry in folder.iterdir() if entry.is_file()]
    if damaged != original and name in ("samples.journal", "log.jsonl"):
        assert damaged in kept, "the damaged original is kept for good"
    if verdict.condition is Condition.BROKEN:
        assert (folder / "samples.journal").exists(), "what cannot be recovered is left alone"
        return
    _check(folder, name, original, hit if damaged != original else set(), tally)


def _check(folder: Path, name: str, original: bytes, hit: set[int], tally: Tally) -> None:
    run = open_run(folder)
    truth = [(n + 0.1 + row / 100, n, 100.0 * n + row) for n in range(RECORDS) for row in range(ROWS)]
    table = run.table("samples")
    times, records = table["time"].to_numpy(), table["record"].to_numpy()
    positions = table["position"].to_numpy()
    by_position = {round(position): (index, row) for index, row in enumerate(truth) for position in (row[2],)}
    found = []
    for time, record, position in zip(times, records, positions, strict=True):
        index, (true_time, true_record, true_position) = by_position[round(float(position))]
        assert (time, record) == (true_time, true_record)
        np.testing.assert_allclose(position, true_position, rtol=1e-12)
        found.append(index)
    assert found == sorted(set(found)), "in order, and none twice"
    missing = set(range(len(truth))) - set(found)
    may_miss: set[int] = set()
    if name == "samples.journal":
        for begin, end, rows in rows_by_byte(original):
            if any(begin <= byte < end for byte in hit):
                may_miss |= set(rows)
    tally.lost_rows += len(missing)
    tally.lost_outside += len(missing - may_miss)
    assert missing <= may_miss, "nothing outside the damaged frames is lost"
    outcomes = dict(zip(run.records["record"], run.records["outcome"], strict=True))
    for index in missing:
        assert outcomes[truth[index][1]] != "complete", "a record that misses samples is not complete"
    if name == "log.jsonl":
        _check_log(original, hit, outcomes)


def _check_log(original: bytes, hit: set[int], outcomes: dict[int, str]) -> None:
    """A record one of whose lines was damaged is not complete."""
    at, opened = 0, -1
    for line in original.split(b"\n")[:-1]:
        said = json.loads(line)
        if said["kind"] == "record" and said["state"] == "open":
            opened = said["record"]
        touched = any(at <= byte < at + len(line) for byte in hit)
        if touched and opened >= 0 and outcomes.get(opened) == "complete":
            raise AssertionError(f"record {opened} is complete although {said['kind']!r} was damaged")
        if said["kind"] == "record" and said["state"] == "closed":
            opened = -1
        at += len(line) + 1


def torture(runs: Path, trials: int, seed: int) -> Tally:
    """Try random corruptions; raises at the first that breaks a promise, and names it."""
    whole, tally = make_unclosed(runs / "whole"), Tally()
    for trial in range(trials):
        try:
            corrupt_once(whole, runs / "copy" / whole.name, random.Random(f"{seed}-{trial}"), tally)
        except (AssertionError, RigctlError) as problem:
            raise AssertionError(f"corruption {trial} of seed {seed}: {problem}") from problem
    return tally
