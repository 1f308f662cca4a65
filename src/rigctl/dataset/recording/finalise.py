"""Makes a run's tables from its two append-only files.

In: the journal, the log and the annotations of a run's folder. Out: ``samples.parquet``, ``records.parquet``,
``events.parquet``, and ``run.json`` with their checksums. This is how a run is closed, and also how one is
recovered whose program was killed: closing is nothing but recovery without a loss.

The order makes it repeatable at every point: ``run.json`` is written after the files that it vouches for, and
the journal goes last.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from rigctl.dataset import run_json
from rigctl.dataset.annotations import NAME as ANNOTATIONS
from rigctl.dataset.annotations import as_data, excluded_records, read_annotations
from rigctl.dataset.history import (
    COMPLETE,
    DAMAGED,
    History,
    RecordEntry,
    ended_at,
    read_history,
)
from rigctl.dataset.parquet import write_table
from rigctl.dataset.pass_fail import judge
from rigctl.dataset.recording import journal, log, records_file, samples_file
from rigctl.dataset.recording.samples_file import SampleFacts, sample_facts, set_aside_journal, write_samples
from rigctl.dataset.recording.writer_lock import lock_folder
from rigctl.wording import number_of

#: version of the format of a run's folder
FORMAT: Final = 2
#: files with a checksum in run.json; annotations.jsonl only if it exists
CHECKED: Final = (samples_file.NAME, records_file.RECORDS, records_file.EVENTS, log.NAME, ANNOTATIONS)


def finalise(folder: Path) -> dict[str, Any]:
    """Make the run's tables and ``run.json`` from its journal, log and annotations; return ``run.json``.

    A pure function of those files, byte for byte: it may be repeated, and interrupted anywhere. The journal
    is removed last, after ``samples.parquet`` has been read back and found complete; a damaged one is kept
    under another name. The caller must hold the folder's lock.

    The outcome of a record with missing samples is `DAMAGED`, regardless of the log.

    Raises
    ------
    RigctlError
        a file is damaged or the disk is full; no measured data are lost.
    """
    history = read_history(folder)
    last = history.sessions[-1] if history.sessions else None
    number, offset = (last.number, last.offset) if last else (0, 0.0)
    # 1. The samples, first of all: what is missing of them decides the outcome of the records.
    facts = write_samples(folder, history.header, number, offset)
    _end_interrupted(history, facts)
    missing = _mark_damaged(history, facts)
    # 2. Events and records, from the log.
    by_time = history.header.source != "import"
    write_table(folder / records_file.EVENTS, records_file.events_table(history.events, by_time=by_time))
    while True:
        known = _files(folder, (ANNOTATIONS,))
        annotations = read_annotations(folder)
        write_table(
            folder / records_file.RECORDS,
            records_file.records_table(history.records, excluded_records(annotations)),
        )
        files = _files(folder, CHECKED)
        if files.get(ANNOTATIONS) == known.get(ANNOTATIONS):
            break  # otherwise one has just been added by another program, and is not in the table
    # 3. What this session lacks, for the reason in ``run.json``: records first, as they are what a person
    #   repeats.
    cut_short = [
        entry.index for entry in history.records if entry.session == number and entry.outcome == DAMAGED
    ]
    lost = facts.losses[number].rows if number in facts.losses else 0
    info = {**_summary(history, facts, missing), "annotations": as_data(annotations), "files": files}
    if info["reason"] is None:
        info["reason"] = _damage(cut_short, max(missing, lost) if cut_short else lost, history.damaged_lines)
    # 4. From here on the run counts as closed.
    run_json.write_info(folder, info)
    set_aside_journal(folder, number, misses=bool(cut_short) or lost > 0)
    return info


def _damage(records: Sequence[int], rows: int, lines: Collection[int]) -> str | None:
    """Return what is missing from the files of a session that came to its end; None if nothing is."""
    found = []
    if rows:
        which = f", of record {', '.join(map(str, records))}" if records else ""
        found.append(f"{number_of(rows, 'sample')}{which}")
    if lines:
        found.append(f"{number_of(len(lines), 'line')} of its log")
    if not found:
        return None
    verb = "is" if rows + len(lines) == 1 else "are"
    return f"files of the run were damaged while it was in progress: {' and '.join(found)} {verb} lost"


def _files(folder: Path, names: Iterable[str]) -> dict[str, Any]:
    """Return the sizes and checksums of the files that exist."""
    return {name: run_json.file_facts(folder / name) for name in names if (folder / name).exists()}


def recovered_history(folder: Path) -> History:
    """Return the history from a run's log, with incomplete records marked; an unclosed run is closed first.

    Raises
    ------
    RigctlError
        as `finalise`; or a program is writing to the run.
    """
    if (folder / journal.NAME).exists() or not (folder / samples_file.NAME).exists():
        with lock_folder(folder):
            finalise(folder)
    history = read_history(folder)
    _mark_damaged(history, sample_facts(folder))
    return history


def _end_interrupted(history: History, facts: SampleFacts) -> None:
    """End a record that was never closed with its last sample."""
    for entry in history.records:
        if entry.end is None:
            entry.end = max(entry.start, facts.last_of_record.get(entry.index, entry.start))


def _mark_damaged(history: History, facts: SampleFacts) -> int:
    """Count the missing samples according to the log; records that miss some become damaged."""
    missing = 0
    for entry in history.records:
        # logs of earlier versions have no sample counts; a record without samples is incomplete all the same
        due = entry.rows if entry.rows is not None else int(_measured(history, entry))
        short = due - facts.rows_of_record[entry.index]
        if short > 0:
            entry.outcome = DAMAGED
            missing += short
    return missing


def _measured(history: History, entry: RecordEntry) -> bool:
    """Return whether a record of a bench lasted long enough for at least two samples."""
    took = (entry.end or entry.start) - entry.start
    return history.header.source == "bench" and took * entry.rate >= 2.0


def _summary(history: History, facts: SampleFacts, missing: int) -> Mapping[str, Any]:
    """Return the content of ``run.json`` without annotations and checksums."""
    last = max(history.last_time, facts.last_time)
    # the times of a file may be a clock's, or continue those of an earlier file
    first = facts.first_time if history.header.source == "import" and facts.rows else 0.0
    return {
        "format": FORMAT,
        **history.header.to_json(),
        "status": history.status,
        "reason": history.reason,
        "unconfirmed": history.unconfirmed,
        **({"absences": [asdict(one) for one in history.absences]} if history.absences else {}),
        "ended": ended_at(history, last - first).isoformat(),
        "duration": last - first,
        "records": len(history.records),
        "complete_records": sum(entry.outcome == COMPLETE for entry in history.records),
        "rows": facts.rows,
        "lost_bytes": sum(loss.bytes for loss in facts.losses.values()),
        "lost_rows": max(missing, sum(loss.rows for loss in facts.losses.values())),
        "damaged_lines": list(history.damaged_lines),
        "measures": records_file.measured_values(history.measures),
        "test": judge(history).to_json(),
        "sessions": [
            {
                "session": session.number,
                "offset": session.offset,
                **session.facts,
                "ended": session.ended,
                "status": session.status,
                "reason": session.reason,
            }
            for session in history.sessions
        ],
    }
