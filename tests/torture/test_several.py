from __future__ import annotations

from torture.several import ENDINGS, FAULTS, OUTPUTS, draw


def test_the_first_endings_have_every_fault_on_every_device_and_every_ending() -> None:
    """Carried out by `make torture`: its times depend on how busy the computer is."""
    trials = [draw(f"0-{number}") for number in range(80)]
    assert trials == [draw(trial.seed) for trial in trials]
    assert {(one.device, one.fault) for one in trials} == {
        (name, fault) for name in OUTPUTS for fault in FAULTS
    }
    assert {one.ending for one in trials} == set(ENDINGS)
    assert all(one.ending != "by itself" or one.fault in ("dead", "hung", "exchanged") for one in trials)
