"""What each action does on the bench, in virtual time on the plain plant."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

Do = Callable[..., Any]


def test_wait_lasts_exactly_as_long_as_it_says(do: Do) -> None:
    done = do("steps:\n  - wait: 12.3 s\n")
    begin, end = (event["time"] for event in done.events("step"))
    assert done.result.status == "finished"
    assert end - begin == pytest.approx(12.3, abs=1e-9)
