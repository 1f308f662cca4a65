from __future__ import annotations

from pathlib import Path

import pytest

from torture.lying import KINDS, RESTARTS, Device, Tally, Trial, one, torture


def test_lying_and_exchanged_devices_are_found_out_at_random_endings(tmp_path: Path) -> None:
    tally = torture(tmp_path, 1, KINDS, iter(range(6)))
    assert tally.failures == []
    assert tally.left_on_and_said >= 2


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("fault", ["lie", "force", "refuse", "exchanged"])
def test_an_output_that_stays_on_is_reported_behind_every_protocol(
    tmp_path: Path, kind: str, fault: str
) -> None:
    """The run ends as planned, and its last 'off' is not carried out."""
    tally = Tally()
    one(tmp_path, Trial("0", kind, "finish", fault, 3.5, 1e6, 7.0), tally)
    assert (tally.unconfirmed, tally.left_on_and_said) == (1, 1)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("fault", RESTARTS)
def test_a_restart_within_a_record_is_found_behind_every_protocol(
    tmp_path: Path, kind: str, fault: str
) -> None:
    tally = Tally()
    one(tmp_path, Trial("0", kind, "finish", fault, 2.3, 1e6, 7.0), tally)
    assert tally.statuses == {"failed": 1}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", ["0", "1", "3"])
@pytest.mark.parametrize("ending", ["interlock", "fail"])
def test_a_loose_contact_hides_no_limit_and_ends_no_wait_behind_every_protocol(
    tmp_path: Path, kind: str, seed: str, ending: str
) -> None:
    tally = Tally()
    result = one(tmp_path, Trial(seed, kind, ending, "intermittent", 1.5, 1e6, 3.0), tally)
    assert result.status in ("aborted", "failed")


def test_a_restart_that_nobody_can_notice_is_not_counted(tmp_path: Path) -> None:
    """The second heater is off 2 ms before its own command, which is on its way."""
    tally = torture(tmp_path, "56", ("lines",), iter([9]), RESTARTS)
    assert (tally.failures, tally.complete) == ([], 1)


def test_a_complete_record_with_other_outputs_than_stored_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Device, "between", lambda *_: {0.0})
    with pytest.raises(AssertionError, match="record 0 is complete: heater"):
        one(tmp_path, Trial("0", "modbus", "finish", "none", 1.5, 1e6, 7.0), Tally())
