"""Where shipped files are found."""

from __future__ import annotations

from pathlib import Path

import pytest

import rigctl.errors
from rigctl.files.shipped import shipped


def test_in_a_checkout_the_repository_ships_its_own_files() -> None:
    assert shipped("rigs", "hl32-bench.yaml").is_file()


def test_an_installed_package_brings_them_along(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "site-packages" / "rigctl"
    (package / "shipped" / "rigs").mkdir(parents=True)
    monkeypatch.setattr(rigctl.errors, "__file__", str(package / "errors.py"))
    assert shipped("rigs") == package / "shipped" / "rigs"
