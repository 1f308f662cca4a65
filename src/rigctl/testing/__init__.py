"""For tests of procedures, rigs and drivers: a bench in virtual time, a fake serial device, assertions.

Nothing here waits: two hours of heating are a matter of milliseconds, and one seed gives one set of samples.
"""

from rigctl.clock import VirtualClock
from rigctl.testing.assertions import (
    assert_commanded,
    assert_finished,
    assert_outcome,
    assert_safe,
    assert_tripped,
)
from rigctl.testing.bench import VirtualBench
from rigctl.testing.clock import ScriptedClock
from rigctl.testing.control import ScriptedControl
from rigctl.testing.run_log import RunLog
from rigctl.testing.serial import Device, FakeDevice, FakeSerial, line_bench

__all__ = [
    "Device",
    "FakeDevice",
    "FakeSerial",
    "RunLog",
    "ScriptedClock",
    "ScriptedControl",
    "VirtualBench",
    "VirtualClock",
    "assert_commanded",
    "assert_finished",
    "assert_outcome",
    "assert_safe",
    "assert_tripped",
    "line_bench",
]
