"""Where shipped files are found."""

from __future__ import annotations

from pathlib import Path

import pytest

import rigctl.errors
from rigctl.files.shipped import shipped


def test_in_a_checkout_shipped_files_are_those_of_the_repository() -> None:
    assert shipped("rigs", "hl32-bench.yaml").is_file()


def test_an_installed_package_has_its_own_shipped_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "site-packages" / "rigctl"
    (package / "shipped" / "rigs").mkdir(parents=True)
    monkeypatch.setattr(rigctl.errors, "__file__", str(package / "errors.py"))
    assert shipped("rigs") == package / "shipped" / "rigs"
