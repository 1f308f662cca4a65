"""The archive of an FMU, examined before it is unpacked or any of its code runs."""

from __future__ import annotations

import hashlib
import zipfile
from pathlib import Path, PurePosixPath

from rigctl.errors import Location, RigctlError
from rigctl.files.regular import read_bytes, regular

_ABOUT = "modelDescription.xml"
#: bytes that an FMU may unpack to at most, from which it counts as large, and that its description may have
_LARGEST, _LARGE, _LONGEST = 2_000_000_000, 100_000_000, 50_000_000
#: compression ratio beyond which a large archive is taken for a decompression bomb
_SQUEEZED = 100


def checked_platforms(path: Path) -> list[str]:
    """The platforms for which the FMU contains a binary.

    Raises
    ------
    RigctlError
        the file is not an archive or has no description, it would fill the disk or write elsewhere, or its
        XML declares entities.
    """
    try:
        with open(path, "rb", opener=regular) as file, zipfile.ZipFile(file) as archive:
            return _checked(archive, path.stat().st_size)
    except zipfile.BadZipFile as problem:
        raise RigctlError("this is not an FMU: it is not a zip archive", where=Location(path)) from problem
    except RigctlError as error:
        raise error.at(Location(path)) from None
    except Exception as problem:  # a damaged archive has many ways to fail
        raise RigctlError(f"this is not an FMU: {problem}", where=Location(path)) from problem


def _checked(archive: zipfile.ZipFile, packed: int) -> list[str]:
    """The platforms in an archive of `packed` bytes."""
    entries = archive.infolist()
    size = sum(entry.file_size for entry in entries)
    if size > _LARGEST or size > max(_LARGE, _SQUEEZED * packed):
        raise RigctlError(
            "the FMU unpacks to too much", value=f"{size / 1e6:.0f} MB from {packed / 1e6:.1f} MB"
        )
    for entry in entries:
        name = entry.filename
        if ".." in PurePosixPath(name).parts or name.startswith("/") or "\\" in name or ":" in name:
            raise RigctlError("a file of the FMU lies outside its folder", value=name)
    about = [entry for entry in entries if entry.filename == _ABOUT]
    if not about:
        raise RigctlError(f"this is not an FMU: it has no {_ABOUT}")
    if len(about) > 1:  # readers differ in which of them they take
        raise RigctlError(f"this is not an FMU: it has {len(about)} files {_ABOUT}")
    if about[0].file_size > _LONGEST:
        raise RigctlError(
            "the description of the FMU is too long", value=f"{about[0].file_size / 1e6:.0f} MB"
        )
    text = archive.read(about[0])
    # entities can include local files, or expand beyond the memory
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text or text[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise RigctlError("the description of the FMU declares a document type", value=_ABOUT)
    parts = [PurePosixPath(entry.filename).parts for entry in entries]
    return sorted({one[1] for one in parts if len(one) > 2 and one[0] == "binaries"})


def digest(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(read_bytes(path)).hexdigest()
