"""The shipped kernels: for the current Python and independent of the computer, or else rebuilt."""

from __future__ import annotations

import ctypes
import re
from pathlib import Path

import pytest

from rigctl.engine.compile import _made
from rigctl.engine.kernels import portable
from rigctl.engine.machine_code import loaded

KERNELS = ("record", "step", "variances", "likelihood")
RETURNS = f"define i32 @{portable.SYMBOL}() {{\n  ret i32 42\n}}\n"


@pytest.mark.parametrize("module", KERNELS)
def test_a_kernel_is_made_from_the_present_python(module: str) -> None:
    text = portable.kept_text(module)
    assert text is not None, "run 'python tools/make_kernels.py'"
    assert f"i32 @{portable.SYMBOL}(" in text
    # nothing of the computer or of the process that wrote it
    assert not re.search(r"inttoptr \(i64 \d{4,} ", text)
    assert "target " not in text and "site-packages" not in text
    # another processor than this one: no vectors yet, and nothing but what every C library has
    assert not re.search(r"<\d+ x double>", text)
    assert set(re.findall(r"^declare [^@]*@([a-z]\w*)\(", text, re.MULTILINE)) <= {"sqrt", "pow"}


def test_a_kernel_of_other_python_and_a_damaged_one_are_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
def test_a_kernel_that_is_not_there_or_cannot_be_read_is_made(
    kept: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(portable, "kept_text", lambda module: kept)
    monkeypatch.setattr(portable, "made_text", lambda module: RETURNS)
    (address,) = loaded(_made("record", False)).values()
    assert ctypes.CFUNCTYPE(ctypes.c_int32)(address)() == 42
