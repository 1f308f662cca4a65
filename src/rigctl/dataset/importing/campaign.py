"""Several files as one campaign: each is one record, unless it distinguishes several."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rigctl.dataset.importing.cells.time_column import with_time_column
from rigctl.dataset.importing.formats.formats import open_source, stem_of
from rigctl.dataset.importing.formats.table import Heading, Labels, RowBlock, Source
from rigctl.dataset.importing.log_format import require_same_unit
from rigctl.dataset.importing.options import Options
from rigctl.errors import Location, RigctlError
from rigctl.printable import shown_path


@dataclass(frozen=True)
class Campaign:
    """Files that are read one after the other; the values of a column that a file lacks are missing.

    Parameters
    ----------
    sources: in the order given by the user.
    names: of their records.
    origin: of the earliest; see `Source`.
    """

    sources: Sequence[Source]
    names: Sequence[str]
    options: Options
    headings: tuple[Heading, ...]
    origin: int | None
    remarks: tuple[str, ...]

    @property
    def path(self) -> Path:
        """The first of the files."""
        return self.sources[0].path

    def parts(self, wanted: Collection[int], record: int | None) -> Iterator[RowBlock]:
        """Yield the rows of one file after the other."""
        for source, name in zip(self.sources, self.names, strict=True):
            positions = {self._ours(heading): index for index, heading in enumerate(source.headings)}
            indices = {index: positions.get(self._ours(self.headings[index])) for index in wanted}
            label_index = None if record is None else positions.get(self._ours(self.headings[record]))
            present = [index for index in indices.values() if index is not None]
            shift = self._shift(source)
            for part in source.parts(present, label_index):
                yield self._part(part, source, indices, name, shift)

    @property
    def merged(self) -> frozenset[str]:
        """Return the columns that have another name in another file."""
        names = {heading.name for source in self.sources for heading in source.headings}
        return frozenset(names - {heading.name for heading in self.headings})

    def _ours(self, heading: Heading) -> str:
        """Return the name to which a column is mapped."""
        return self.options.ours(heading.name)

    def _shift(self, source: Source) -> float:
        """Return the seconds from the campaign's time zero to the file's."""
        if self.origin is None or source.origin is None:
            return 0.0
        return (source.origin - self.origin) / 1e9

    def _part(
        self, part: RowBlock, source: Source, indices: dict[int, int | None], name: str, shift: float
    ) -> RowBlock:
        import numpy as np

        columns = {}
        for index, source_index in indices.items():
            if source_index is None:
                columns[index] = np.full(len(part.lines), np.nan)
            elif self.headings[index].seconds and shift:
                columns[index] = part.columns[source_index] + shift
            else:
                columns[index] = part.columns[source_index]
        faults = tuple(replace(fault, path=source.path) for fault in part.faults)
        return replace(part, columns=columns, labels=_labels(part, name), faults=faults, path=source.path)


def open_files(paths: Sequence[Path], options: Options) -> Source:
    """Open the files of a campaign.

    Raises
    ------
    RigctlError
        a file cannot be read or is given twice, or a column does not have the same unit in every file.
    """
    if len(paths) == 1:
        return open_source(paths[0], options)
    doubled = next((path for number, path in enumerate(paths) if path in paths[:number]), None)
    if doubled is not None:
        raise RigctlError("the file is named twice", where=Location(doubled))
    sources = [open_source(path, options) for path in paths]
    for source in sources:
        options = with_time_column(((heading.name, heading.unit) for heading in source.headings), options)
    headings = _headings(sources, options)
    origins = [source.origin for source in sources]
    known = [origin for origin in origins if origin is not None]
    remarks = [f"{source.path.name}: {remark}" for source in sources for remark in source.remarks]
    if known and len(known) < len(origins):
        remarks.append("only some of the files say when they were measured; the others begin at time zero")
    return Campaign(sources, _names(paths), options, headings, min(known, default=None), tuple(remarks))


def _names(paths: Sequence[Path]) -> list[str]:
    """Return unique names of the files, without their extensions."""
    stems = [stem_of(path) for path in paths]
    return [
        f"{path.parent.name}/{stem}" if stems.count(stem) > 1 else stem
        for path, stem in zip(paths, stems, strict=True)
    ]


def _headings(sources: Sequence[Source], options: Options) -> tuple[Heading, ...]:
    headings: dict[str, Heading] = {}
    for source in sources:
        for heading in source.headings:
            if not heading.name:
                continue
            require_same_unit(heading, options)
            first = headings.setdefault(options.ours(heading.name), heading)
            given = options.unit_of(heading.name) or heading.unit
            wanted = options.unit_of(first.name) or first.unit
            if (wanted, first.seconds) != (given, heading.seconds):
                raise RigctlError(
                    f"{heading.name}: its unit is not the same in every file",
                    value=given or "no unit",
                    expected=f"{wanted or 'no unit'} as in {shown_path(first.where.file)}",
                    where=heading.where,
                )
    return tuple(headings.values())


def _labels(part: RowBlock, name: str) -> Labels:
    """Label a file's rows by the file; records that it distinguishes also have their own name."""
    import numpy as np

    if part.labels is None:
        return Labels(np.zeros(len(part.lines), dtype=np.int64), (name,), named=True)
    texts = tuple(text if text.strip() in ("", "-1") else f"{name} {text}" for text in part.labels.texts)
    return Labels(part.labels.codes, texts)
