"""A record faster than the bench can be sampled is refused anywhere in a procedure."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.planning import preview
from rigctl.planning.rates import refuse_rates
from rigctl.procedure import expand, parse_procedure
from rigctl.rig import load_rig


def test_a_loop_between_records_that_is_too_fast_is_refused() -> None:
    """It used to be refused when its turn came, with the steps before it done."""
    rig = load_rig(shipped("rigs", "tclab-board.yaml"))
    loop = "{actuator: heater_1, channel: temperature_1, to: 50 degC, gain: 4 %/K, rate: RATE, for: 1 min}"
    text = f"procedure: p\nsteps:\n  - wait: 1 s\n  - control: {loop}\n"
    refuse_rates(expand(parse_procedure(text.replace("RATE", "10 Hz")), rig, {}))
    with pytest.raises(RigctlError, match="20 Hz is more than the device can be asked for: 10 Hz"):
        refuse_rates(expand(parse_procedure(text.replace("RATE", "20 Hz")), rig, {}))


def test_a_record_faster_than_the_board_is_refused_before_the_run() -> None:
    """It used to end the run when the record began; `check` said nothing."""
    rig = load_rig(shipped("rigs", "hl32-bench-uno.yaml"))
    text = "procedure: p\nsteps:\n  - record: {name: fast, rate: RATE}\n    do: [wait: 1 s]\n"
    plans = [expand(parse_procedure(text.replace("RATE", rate)), rig, {}) for rate in ("2 kHz", "5 kHz")]
    refuse_rates(plans[0])
    said = "5000 Hz is more than the device can be asked for: 2000 Hz"
    with pytest.raises(RigctlError, match=said):
        refuse_rates(plans[1])
    (warning,) = (message for _, message in preview(plans[1]).warnings)
    assert said in warning
    simulated = expand(
        parse_procedure(text.replace("RATE", "5 kHz")), load_rig(shipped("rigs", "hl32-bench.yaml")), {}
    )
    refuse_rates(simulated)
    with pytest.raises(RigctlError, match=said):
        refuse_rates(simulated, "emulated")


@pytest.mark.parametrize("block", ["on_failure", "on_abort", "finally"])
@pytest.mark.parametrize("nested", [False, True])
def test_a_record_that_is_too_fast_in_a_cleanup_block_is_refused(block: str, *, nested: bool) -> None:
    """It used to be refused only when the cleanup had begun, or recorded at another rate."""
    rig = load_rig(shipped("rigs", "tclab-board.yaml"))
    record = "- record: {name: fast, rate: 50 Hz}"
    if nested:
        text = f"""\
procedure: p
steps:
  - repeat: 2
    do: [wait: 1 s]
    {block}:
      {record}
        do: [wait: 1 s]
"""
    else:
        text = f"""\
procedure: p
steps: [wait: 1 s]
{block}:
  {record}
    do: [wait: 1 s]
"""
    plan = expand(parse_procedure(text, Path("p.yaml")), rig, {})
    with pytest.raises(RigctlError, match="50 Hz is more than the device can be asked for") as refused:
        refuse_rates(plan)
    assert "p.yaml" in str(refused.value)
