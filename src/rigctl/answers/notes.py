"""Which remarks on the data are shown beside an answer, and which only with the evidence."""

from __future__ import annotations

from collections.abc import Iterable

from rigctl.answers import blocks
from rigctl.model.measured.note import Note


def routine(notes: Iterable[Note]) -> list[Note]:
    """The notes that only describe how the data were taken, which every answer would repeat."""
    return [note for note in notes if note.kind != "unusual"]


def unusual(notes: Iterable[Note]) -> list[blocks.Note]:
    """The other notes: those that a reader has to know before trusting a verdict."""
    return [blocks.Note(note.text) for note in notes if note.kind == "unusual"]


def all_notes(notes: Iterable[Note]) -> list[blocks.Note]:
    """The notes except those on spikes, which the note on the noise and the table of channels state."""
    return [blocks.Note(note.text) for note in notes if note.kind != "spikes"]
