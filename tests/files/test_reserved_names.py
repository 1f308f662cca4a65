"""Names of devices on Windows, which no file of rigctl gets."""

from __future__ import annotations

import os
from pathlib import Path, PureWindowsPath

import pytest

from rigctl.dataset.outputs import require_folder, require_output
from rigctl.dataset.run_id import slug
from rigctl.errors import RigctlError
from rigctl.files.reserved_names import is_reserved, reserved_part


@pytest.mark.parametrize(
    "name", ["con", "CON.yaml", "aux", "nul.tar.gz", "Com1.csv", "lpt9", "con .txt", "com¹"]
)
def test_a_device_of_windows_is_recognised_whatever_follows_its_name(name: str) -> None:
    assert is_reserved(name)


@pytest.mark.parametrize("name", ["console.yaml", "com10.csv", "auxiliary", "a.con", "com", "nuller"])
def test_other_names_are_free(name: str) -> None:
    assert not is_reserved(name)


def test_a_reserved_folder_is_found_in_a_path() -> None:
    assert reserved_part(PureWindowsPath(r"C:\lab\aux\rig.yaml")) == "aux"
    assert reserved_part(PureWindowsPath(r"C:\lab\rigs\rig.yaml")) is None


def test_no_lock_or_run_is_named_like_a_device() -> None:
    assert slug("AUX") == "run-aux"
    assert slug("com 1") == "com-1"


@pytest.mark.parametrize("name", ["con.csv", "aux/page.html"])
def test_an_output_named_like_a_device_is_refused_on_windows(tmp_path: Path, name: str) -> None:
    with pytest.raises(RigctlError, match="a device on Windows"):
        require_output(tmp_path / name, windows=True)
    with pytest.raises(RigctlError, match="a device on Windows"):
        require_folder(tmp_path / name, windows=True)
    if os.name != "nt":
        require_output(tmp_path / name)
