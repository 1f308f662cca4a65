"""Write the kernels of the engine as LLVM code, from their Python source: ``python tools/make_kernels.py``.

Run it after a change of `rigctl.engine.kernels`, and commit its output. The code is for any processor, and
only has to be optimised on each computer, see `rigctl.engine.kernels.portable`.
"""

from __future__ import annotations

from rigctl.engine.kernels.making import text_of
from rigctl.engine.kernels.portable import keep

KERNELS = ("record", "step", "variances", "likelihood")


def main() -> None:
    for kernel in KERNELS:
        text = text_of(kernel)
        path = keep(kernel, text)
        print(f"{path.name}: {len(text)} characters, {path.stat().st_size} bytes")


if __name__ == "__main__":
    main()
