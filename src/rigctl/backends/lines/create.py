"""Makes the bench of a line-based device."""

from __future__ import annotations

from dataclasses import replace

from rigctl.backends.lines.bench import LineBench
from rigctl.backends.lines.setting import Setter
from rigctl.backends.transport.adapter import same_adapter
from rigctl.backends.transport.address import SERIAL, Address
from rigctl.backends.transport.guard import GuardSettings
from rigctl.backends.transport.port import Port
from rigctl.backends.transport.safe_commands import Duty
from rigctl.backends.transport.safe_state_retries import LASTS
from rigctl.clock import Clock
from rigctl.rig import Lines, Rig


def line_bench(rig: Rig, lines: Lines, clock: Clock, address: Address) -> LineBench:
    """Make a bench at an address, not yet open.

    If it drives anything, a guard holds the port, so that outputs become safe even if this process ends or
    hangs.
    """
    setter, duty = Setter(rig, lines), Duty()
    orders = GuardSettings(
        address,
        setter.orders(),
        lines.watchdog,
        confirm=setter.confirm_order(),
        read_back=setter.read_back_orders(),
        identify=setter.identify_order(),
        reply_ends=lines.reply_ends,
        timeout=max(lines.timeout, GuardSettings.timeout),
    )

    def connect() -> Port:
        if orders.safe:
            from rigctl.backends.transport.guard_port import GuardedPort

            return GuardedPort(replace(orders, identity=duty.identity), clock, duty)
        return address.open(clock)

    again = same_adapter(connect, address.url) if address.kind in SERIAL else connect
    hours = LASTS / 3600.0
    without_host = (
        f"its guard goes on trying for {hours:g} h while this computer runs; 'rigctl doctor' shows it"
    )
    return LineBench(rig, lines, clock, again, kind=address.kind, duty=duty, without_host=without_host)
