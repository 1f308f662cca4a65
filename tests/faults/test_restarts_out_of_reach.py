"""A device restarts with its outputs on while its connection is lost, after all was safe at the last contact.

Behind each protocol, in virtual time; the device in memory is the witness.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from torture.lying import AWAY, KINDS, Tally, Trial, one

#: s: all is off and has been read; then the device is gone, and the run ends
GONE, SIGNAL, FINISH = 6.5, 7.0, 8.0


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("ending", ["SIGINT", "SIGTERM", "fail"])
def test_a_device_that_comes_back_soon_is_made_safe_at_the_end(
    tmp_path: Path, kind: str, ending: str
) -> None:
    tally = Tally()
    one(tmp_path, Trial("on", kind, ending, AWAY, GONE, 7.8, SIGNAL), tally)
    assert (tally.unconfirmed, tally.left_on_and_said) == (0, 0)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("ending", "moment"), [("finish", FINISH), ("SIGINT", SIGNAL)])
def test_a_device_that_stays_away_is_reported_with_the_time_it_was_last_seen(
    tmp_path: Path, kind: str, ending: str, moment: float
) -> None:
    tally = Tally()
    result = one(tmp_path, Trial("on", kind, ending, AWAY, GONE, 1e6, moment), tally)
    assert (tally.unconfirmed, tally.left_on_and_said) == (1, 1)
    seen = r"\(safe when last seen at \d\d:\d\d:06; a restart may have switched them on\)"
    assert re.fullmatch(rf"\w+, \w+ {seen}", str(result.unconfirmed))
    assert "switch it off by hand" in str(result.by_hand)


@pytest.mark.parametrize("kind", KINDS)
def test_outputs_that_are_on_for_sure_are_reported_alone(tmp_path: Path, kind: str) -> None:
    result = one(tmp_path, Trial("on", kind, "SIGINT", AWAY, 3.5, 1e6, 3.0), Tally())
    assert "last seen" not in str(result.unconfirmed)
