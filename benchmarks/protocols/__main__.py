"""Modbus TCP polled by a run, 20 registers per sample: ``python -m benchmarks.protocols``.

The server is that of pymodbus, in a separate process on this computer; the bench has all parts of a run:
backend, guard process, client and connection. A network between two computers adds to it.
"""

from __future__ import annotations

import socket
import statistics
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

from benchmarks.board.real_time import go_first
from benchmarks.record import keep, table
from rigctl.backends.protocol import Backend, Sample
from rigctl.backends.registry import create_backend
from rigctl.clock import real_clock
from rigctl.rig import parse_rig

FOLDER = Path(__file__).parent
REGISTERS = 20
SECONDS = 10.0

_SERVER = """
import asyncio, sys
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

async def main():
    bits = [SimData(0, count=16, values=False, datatype=DataType.BITS)]
    registers = [SimData(0, count=64, values=1000, datatype=DataType.REGISTERS)]
    device = SimDevice(1, (bits, bits, registers, registers))
    await ModbusTcpServer(device, address=("127.0.0.1", int(sys.argv[1]))).serve_forever()

asyncio.run(main())
"""


def rig_text() -> str:
    """A device with twenty numbers in adjacent registers, and one output that is read back."""
    names = [f"channel_{index}" for index in range(REGISTERS)]
    registers = "\n".join(f"      {name}: {{table: input, address: {at}}}" for at, name in enumerate(names))
    channels = "\n".join(f"  {name}: {{unit: V, quantity: voltage}}" for name in names)
    return f"""\
name: twenty registers
backend:
  kind: modbus
  modbus:
    channels:
{registers}
    actuators:
      output: {{table: coil, address: 0, readback: false}}
channels:
{channels}
actuators:
  output: {{kind: switch}}
safe_state: {{output: off}}
"""


def polled(bench: Backend, rate: float) -> list[Sample]:
    """The samples of some seconds at a rate in Hz."""
    bench.start(rate)
    end, found = bench.clock.now() + SECONDS, []
    while bench.clock.now() < end:
        sample = bench.next_sample(1.0)
        if sample is not None:
            found.append(sample)
    return found


def missing(bench: Backend) -> int:
    """Samples that could not be taken in time."""
    gaps = [notice.fields for notice in bench.take_notices() if notice.kind == "gap"]
    return sum(int(str(fields["samples"])) for fields in gaps)


def main() -> None:
    scheduling = go_first()  # including server and guard, which are child processes
    with socket.create_server(("127.0.0.1", 0)) as free:
        number = free.getsockname()[1]
    with subprocess.Popen([sys.executable, "-c", _SERVER, str(number)]) as server:
        try:
            time.sleep(2.0)
            bench = create_backend(parse_rig(rig_text()), None, real_clock(), {"port": f"127.0.0.1:{number}"})
            bench.open()
            results: dict[str, Any] = {"registers": REGISTERS, "scheduling": scheduling}
            for name, rate in (("at 100 Hz", 100.0), ("as fast as it goes", 2000.0)):
                found = polled(bench, rate)
                steps = sorted(b.time - a.time for a, b in pairwise(found))
                results[name] = {
                    "rate_hz": len(found) / SECONDS,
                    "missing": missing(bench) if rate == 100.0 else None,
                    "interval_ms": {
                        "median": 1e3 * statistics.median(steps),
                        "p99": 1e3 * steps[int(0.99 * len(steps))],
                    },
                }
            bench.close()
        finally:
            server.kill()
    rows = [
        ("samples a second, asked for 100", f"{results['at 100 Hz']['rate_hz']:.1f}", "100"),
        ("samples missing of 1000", f"{results['at 100 Hz']['missing']}", "0"),
        ("interval, ms, 99 % within", f"{results['at 100 Hz']['interval_ms']['p99']:.1f}", ""),
        ("samples a second at the most", f"{results['as fast as it goes']['rate_hz']:.0f}", "100"),
    ]
    table(f"Modbus TCP, {REGISTERS} registers a sample", [("", "reached", "asked"), *rows])
    print(f"\nkept in {keep(FOLDER, results, 'pymodbus')}")


if __name__ == "__main__":
    sys.exit(main())
