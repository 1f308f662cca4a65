"""Precompiled kernels: LLVM IR shipped with the package, which needs no Python compiler at run time.

``python tools/make_kernels.py`` compiles them from the Python modules in this folder. A kernel whose sources
have changed since is compiled again at run time, which requires numba and takes some ten seconds.
"""

from __future__ import annotations

import lzma
from hashlib import sha256
from pathlib import Path

#: name of the only function of a kernel: ``int32 kernel(void *, void **, int64 *words)``. The first two
#: arguments follow numba's calling convention, for a result and an error; non-zero return values are errors.
SYMBOL = "kernel"

HERE = Path(__file__).parent
FOLDER = HERE / "ir"


def fingerprint() -> str:
    """SHA-256 of the Python sources of the kernels, independent of line endings."""
    content = sha256()
    for path in sorted(HERE.glob("*.py")):
        content.update(path.read_bytes().replace(b"\r\n", b"\n"))
    return content.hexdigest()


def keep(module: str, text: str) -> Path:
    """Write the LLVM IR of a kernel, with the fingerprint of its sources."""
    FOLDER.mkdir(exist_ok=True)
    path = _path(module)
    path.write_bytes(lzma.compress(f"; {fingerprint()}\n{text}".encode(), preset=9 | lzma.PRESET_EXTREME))
    return path


def kept_text(module: str) -> str | None:
    """The shipped LLVM IR of the kernel in `module`; None if missing or made from other sources."""
    try:
        text = lzma.decompress(_path(module).read_bytes()).decode()
    except (OSError, lzma.LZMAError, ValueError):
        return None
    return text if text.startswith(f"; {fingerprint()}\n") else None


def _path(module: str) -> Path:
    return FOLDER / f"{module}.ll.xz"


def made_text(module: str) -> str:
    """LLVM IR of the kernel in `module`, compiled from its Python; checks indices under `engine.guards`."""
    from rigctl.engine.kernels.making import text_of

    return text_of(module)
