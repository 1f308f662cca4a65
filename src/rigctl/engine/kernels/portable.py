"""Kernels as they come with this package: in LLVM's language, for a computer that has no compiler of Python.

``python tools/make_kernels.py`` writes them from the Python beside this module. A kernel whose Python has
changed since is made from that, which takes numba and some ten seconds.
"""

from __future__ import annotations

import lzma
from hashlib import sha256
from pathlib import Path

#: of the one function of a kernel: ``int32 kernel(void *, void **, int64 *words)``. The first two are
#: numba's, for a result and for an error; another number than 0 is returned where there is one.
SYMBOL = "kernel"

HERE = Path(__file__).parent
FOLDER = HERE / "ir"


def fingerprint() -> str:
    """Of the Python that the kernels are made from, however its lines end."""
    content = sha256()
    for path in sorted(HERE.glob("*.py")):
        content.update(path.read_bytes().replace(b"\r\n", b"\n"))
    return content.hexdigest()


def keep(module: str, text: str) -> Path:
    """Write a kernel's text, and what it was made from."""
    FOLDER.mkdir(exist_ok=True)
    path = _path(module)
    path.write_bytes(lzma.compress(f"; {fingerprint()}\n{text}".encode(), preset=9 | lzma.PRESET_EXTREME))
    return path


def kept_text(module: str) -> str | None:
    """The kernel in `module` of this package as it came with it; None of other Python than is beside it."""
    try:
        text = lzma.decompress(_path(module).read_bytes()).decode()
    except (OSError, lzma.LZMAError, ValueError):
        return None
    return text if text.startswith(f"; {fingerprint()}\n") else None


def _path(module: str) -> Path:
    return FOLDER / f"{module}.ll.xz"


def made_text(module: str) -> str:
    """The same, made from its Python; that checks indices where `engine.guards` say so."""
    from rigctl.engine.kernels.making import text_of

    return text_of(module)
