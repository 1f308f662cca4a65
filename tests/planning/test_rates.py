"""A record faster than the bench can be sampled is refused anywhere in a procedure."""

from __future__ import annotations

from pathlib import Path

import pytest

from commands import refusal
from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.planning import preview
from rigctl.planning.line_capacity import line_capacity
from rigctl.planning.rates import refuse_rates, refuse_slow_answers, too_fast
from rigctl.procedure import expand, parse_procedure
from rigctl.rig import Rig, load_rig, parse_rig


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
    refuse_rates(plans[0], "serial", {"port": "socket://bench:4000"})
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


def changed(name: str, *changes: tuple[str, str]) -> Rig:
    """A shipped rig whose file has other texts in places."""
    path = shipped("rigs", name)
    text = path.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    return parse_rig(text, path)


TCLAB = ("tclab-board.yaml", ("    fastest: 10 Hz", ""))
RTU = ("oil-circuit-modbus.yaml", ("    fastest: 100 Hz", ""))


@pytest.mark.parametrize(
    ("rig", "kind", "options", "fastest"),
    [
        # 'T1' and 'T2' with an answer of one digit, each with its line end: 10 characters; the states of the
        # heaters are asked for once a second
        (TCLAB, "serial", {"baud": 9600}, 9600 / 10 / 10),
        (TCLAB, "serial", {}, 115200 / 10 / 10),
        (
            (*TCLAB, ("    send_ends:", "    frame: '8E2'\n    send_ends:")),
            "serial",
            {"baud": 9600},
            9600 / 12 / 10,
        ),
        (
            (*TCLAB, ('"{temperature_1}"', '"T1: {temperature_1} C"')),
            "serial",
            {"baud": 9600},
            9600 / 10 / 16,
        ),
        (TCLAB, "serial", {"port": "rfc2217://bench:4000", "baud": 9600}, 96.0),
        (TCLAB, "serial", {"port": "socket://bench:4000", "baud": 9600}, None),
        (TCLAB, "simulated", {}, None),
        # 36 characters to a sample of the stream
        (("hl32-bench-uno.yaml",), "serial", {}, 320.0),
        (("hl32-bench-uno.yaml",), "emulated", {"baud": 500000}, 500000 / 360),
        # input 0 to 2, coil 0 and holding 0: three requests of 8 characters, answers of 5 + 6, 5 + 1 and
        # 5 + 2, in a frame of 11 bits; 3.5 characters of silence after each
        (RTU, "modbus", {"port": "/dev/ttyUSB0"}, 19200 / 11 / (3 * 8 + 3 * 5 + 6 + 1 + 2 + 6 * 3.5)),
        (RTU, "modbus", {"port": "192.168.0.20:502", "baud": 9600}, None),
        (RTU, "modbus", {}, None),
        (("oil-circuit-visa.yaml",), "visa", {}, None),
        # 'MEAS:VOLT:DC? (@101,102)' and '0,0', each with its line end
        (("oil-circuit-visa.yaml",), "visa", {"port": "ASRL3::INSTR"}, 9600 / 10 / 29),
    ],
)
def test_a_line_carries_so_many_samples_a_second(
    rig: tuple[str, *tuple[tuple[str, str], ...]],
    kind: str,
    options: dict[str, object],
    fastest: float | None,
) -> None:
    found = line_capacity(changed(*rig), kind, options)
    assert (found.fastest if found is not None else None) == (pytest.approx(fastest) if fastest else None)


def test_check_refuses_a_record_that_the_line_cannot_carry(tmp_path: Path) -> None:
    """50 000 samples at 5000 Hz once became 3260, in a record that counted as complete."""
    rig = changed(*TCLAB)
    (tmp_path / "rig.yaml").write_text(rig.text, encoding="utf-8")
    procedure = tmp_path / "p.yaml"
    text = "procedure: p\nrig: rig.yaml\nsteps:\n  - record: {name: fast, rate: RATE}\n    do: [wait: 10 s]\n"
    procedure.write_text(text.replace("RATE", "5 kHz"), encoding="utf-8")
    said = refusal("check", str(procedure))
    assert f"{procedure.as_posix()}:4:5: record 'fast' at 5000 Hz: 5000 Hz is more than possible" in said
    assert (
        "the line carries 1.15e+03 Hz at most: at 115200 baud, with 10 characters or more for a sample"
        in said
    )
    assert too_fast(rig, 1152.0) is None
    assert too_fast(rig, 1153.0) is not None
    slow = rig.text.replace("baud: 115200", "baud: 300")
    (tmp_path / "rig.yaml").write_text(
        slow.replace("monitor_rate: 2 Hz", "monitor_rate: 5 Hz"), encoding="utf-8"
    )
    procedure.write_text(text.replace("RATE", "2 Hz"), encoding="utf-8")
    assert "monitor_rate: 5 Hz is more than possible: the line carries 3 Hz at most" in refusal(
        "check", str(procedure)
    )


def test_a_loop_on_one_of_several_devices_needs_that_device_at_its_rate() -> None:
    """A record may be faster than a slow device, which then gives fewer readings; a loop on it may not."""
    rig = load_rig(shipped("rigs", "oil-circuit-devices.yaml"))
    loop = "{actuator: relief_valve, channel: CHANNEL, to: 20 bar, gain: 1, rate: RATE, for: 1 min}"
    text = f"procedure: p\nsteps:\n  - control: {loop}\n".replace("CHANNEL", "supply_pressure")
    slow = rig.parts[rig.device_of("supply_pressure")].fastest
    assert slow < rig.fastest
    refuse_rates(expand(parse_procedure(text.replace("RATE", f"{slow:g} Hz")), rig, {}))
    plan = expand(parse_procedure(text.replace("RATE", f"{2.0 * slow:g} Hz")), rig, {})
    with pytest.raises(RigctlError, match="Hz is more than plant can be asked for"):
        refuse_rates(plan)
    assert any("more than plant can be asked for" in message for _, message in preview(plan).warnings)


def test_a_loop_is_not_refused_because_of_a_device_that_it_does_not_read() -> None:
    rig = load_rig(shipped("rigs", "oil-circuit-devices.yaml"))
    text = (
        "procedure: p\nsteps:\n  - control: {actuator: relief_valve, channel: supply_pressure, to: 20 bar, "
        "gain: 1, rate: 10 Hz, for: 1 min}\n"
    )
    plan = expand(parse_procedure(text), rig, {})
    refuse_slow_answers(plan, 3.0, "meter")
    with pytest.raises(RigctlError, match="device 'plant' can deliver"):
        refuse_slow_answers(plan, 3.0, "plant")
