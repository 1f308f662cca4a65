"""The shipped kernels: made from the current source, portable, and rebuilt if they cannot be used."""

from __future__ import annotations

import ctypes
import re
from pathlib import Path

import pytest

from rigctl.engine.compile import _kernel_code
from rigctl.engine.kernels import portable
from rigctl.engine.machine_code import loaded

KERNELS = ("record", "step", "variances", "likelihood")
RETURNS = f"define i32 @{portable.SYMBOL}() {{\n  ret i32 42\n}}\n"


@pytest.mark.parametrize("module", KERNELS)
def test_every_shipped_kernel_is_current_and_portable(module: str) -> None:
    text = portable.kept_text(module)
    assert text is not None, "run 'python tools/make_kernels.py'"
    assert f"i32 @{portable.SYMBOL}(" in text
    # no address, target or path of the computer that wrote it
    assert not re.search(r"inttoptr \(i64 \d{4,} ", text)
    assert "target " not in text and "site-packages" not in text
    # portable between processors: no vectors, and only functions of every C library
    assert not re.search(r"<\d+ x double>", text)
    assert set(re.findall(r"^declare [^@]*@([a-z]\w*)\(", text, re.MULTILINE)) <= {"sqrt", "pow"}


def test_damaged_and_outdated_kernels_are_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(portable, "FOLDER", tmp_path / "ir")
    assert portable.kept_text("record") is None
    path = portable.keep("record", "as it was kept")
    assert str(portable.kept_text("record")).endswith("as it was kept")
    path.write_bytes(path.read_bytes()[:-7])
    assert portable.kept_text("record") is None
    portable.keep("record", "as it was kept")
    monkeypatch.setattr(portable, "fingerprint", lambda: "of other Python")
    assert portable.kept_text("record") is None


@pytest.mark.parametrize("kept", [None, "define this as another version of LLVM would"])
def test_a_missing_or_unreadable_kernel_is_built(kept: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(portable, "kept_text", lambda module: kept)
    monkeypatch.setattr(portable, "made_text", lambda module: RETURNS)
    (address,) = loaded(_kernel_code("record", False)).values()
    assert ctypes.CFUNCTYPE(ctypes.c_int32)(address)() == 42
