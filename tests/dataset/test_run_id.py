from __future__ import annotations

from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.dataset import new_run_id
from rigctl.dataset.run_id import slug

WHEN = datetime(2026, 11, 21, 9, 30, 5, tzinfo=UTC)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("stroke campaign", "stroke-campaign"),
        ("Stroke campaign (40 °C)!", "stroke-campaign-40-c"),
        ("Übergröße", "ubergroe"),
        ("../../etc/passwd", "etc-passwd"),
        ("  ", "run"),
        ("日本", "run"),
        ("x" * 90, "x" * 40),
    ],
)
def test_a_name_is_shortened_to_a_slug(name: str, expected: str) -> None:
    assert slug(name) == expected


@given(name=st.text())
def test_a_slug_is_a_safe_folder_name_everywhere(name: str) -> None:
    assert slug(name)
    assert set(slug(name)) <= set("abcdefghijklmnopqrstuvwxyz0123456789-")
    assert not slug(name).startswith("-")


def test_a_run_id_has_the_time_in_utc_and_is_unique(tmp_path: Path) -> None:
    local = WHEN.astimezone(timezone(timedelta(hours=3)))
    names = []
    for _ in range(3):
        names.append(new_run_id("Stroke", local, tmp_path))
        (tmp_path / names[-1]).mkdir()
    assert names == ["20261121-093005-stroke", "20261121-093005-stroke-2", "20261121-093005-stroke-3"]
