"""Write the kernels of the engine in LLVM's language, from their Python: ``python tools/make_kernels.py``.

Whoever changes a module of `rigctl.engine.kernels` runs it, and commits what it writes. Its output is for any
processor: what a computer still does is to optimise it, see `rigctl.engine.kernels.portable`.
"""

from __future__ import annotations

from rigctl.engine.kernels.making import text_of
from rigctl.engine.kernels.portable import keep

KERNELS = ("record", "step")


def main() -> None:
    for kernel in KERNELS:
        text = text_of(kernel)
        path = keep(kernel, text)
        print(f"{path.name}: {len(text)} characters, {path.stat().st_size} bytes")


if __name__ == "__main__":
    main()
