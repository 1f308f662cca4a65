"""The names of versions."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.files.version_suffix import path_exists, split_version, with_version


@pytest.mark.parametrize(
    "name", ["m.yaml", "m@.yaml", "m.yaml@", "m.yaml@x", "@3", "m.yaml@-1", "m.yaml@1234567"]
)
def test_invalid_suffixes_are_part_of_the_file_name(name: str) -> None:
    assert split_version(Path("models") / name) == (Path("models") / name, None)


def test_a_number_after_the_name_is_a_version(tmp_path: Path) -> None:
    head = tmp_path / "m.yaml"
    assert split_version(with_version(head, 3)) == (head, 3)
    assert not path_exists(with_version(head, 3))
    head.touch()
    assert path_exists(with_version(head, 3))
    with_version(head, 3).touch()  # a file whose real name ends like this
    assert split_version(with_version(head, 3)) == (with_version(head, 3), None)


def test_an_invalid_file_name_does_not_exist() -> None:
    assert not path_exists(Path("a\0b"))
    assert not path_exists(Path("x" * 5000 + "@3"))
