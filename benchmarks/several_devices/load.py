"""Processor time of a run that records 50 channels of four devices.

``python -m benchmarks.several_devices.load``

A whole command, with its guard processes, records registers of four Modbus servers (pymodbus, in a process of
their own) at 100 Hz. What it takes to start and to end is left out: two runs differ in the length of their
record alone, and so does what they take. What rigctl's own process takes is shown by itself; the rest is its
four guards, in which pymodbus runs. Linux only.
"""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

from benchmarks.record import keep, table
from benchmarks.several_devices import FOLDER
from rigctl.dataset import open_run

CHANNELS = {"a": 13, "b": 13, "c": 12, "d": 12}
RATE, SHORT, LONG = 100.0, 10.0, 40.0  # Hz, s, s
ASKED = 20.0  # per cent of a core

_SERVER = """
import asyncio, sys
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

async def main():
    bits = [SimData(0, count=16, values=False, datatype=DataType.BITS)]
    registers = [SimData(0, count=64, values=1000, datatype=DataType.REGISTERS)]
    device = lambda: SimDevice(1, (bits, bits, registers, registers))
    servers = [ModbusTcpServer(device(), address=("127.0.0.1", int(port))) for port in sys.argv[1:]]
    await asyncio.gather(*(server.serve_forever() for server in servers))

asyncio.run(main())
"""


def rig_text(ports: list[int]) -> str:
    """Four devices with adjacent registers."""
    devices, channels, actuators = [], [], []
    for (name, count), port in zip(CHANNELS.items(), ports, strict=True):
        devices += [f"  {name}:", "    kind: modbus", f"    port: 127.0.0.1:{port}", "    modbus:"]
        devices += ["      channels:"]
        devices += [f"        {name}_{k}: {{table: input, address: {k}}}" for k in range(count)]
        devices += ["      actuators:", f"        output_{name}: {{table: coil, address: 0}}"]
        channels += [f"  {name}_{k}: {{device: {name}, unit: V, quantity: voltage}}" for k in range(count)]
        actuators += [f"  output_{name}: {{device: {name}, kind: switch}}"]
    safe = ", ".join(f"output_{name}: off" for name in CHANNELS)
    lines = ["name: four devices", "devices:", *devices, "channels:", *channels, "actuators:", *actuators]
    return "\n".join([*lines, f"safe_state: {{{safe}}}", "stale_after: 5 s", ""])


def seconds_of_a_run(folder: Path, lasts: float) -> tuple[float, float, float]:
    """Processor time of a whole run, and of its own process, s, and the share of samples that it missed."""
    (folder / "procedure.yaml").write_text(
        f"procedure: fifty\nrig: rig.yaml\nsteps:\n"
        f"  - record: {{name: all, rate: {RATE:g} Hz, most_missing: 100 %}}\n"
        f"    do: [{{wait: {lasts:g} s}}]\n",
        encoding="utf-8",
    )
    command = [sys.executable, "-m", "rigctl", "run", "procedure.yaml", "--json"]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as run:
        assert run.stdout is not None
        answer = run.stdout.read()
        os.waitid(os.P_PID, run.pid, os.WEXITED | os.WNOWAIT)
        fields = Path(f"/proc/{run.pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
        own = sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK")
        _, status, used = os.wait4(run.pid, 0)  # with its children, the guards
        run.returncode = os.waitstatus_to_exitcode(status)
    if run.returncode:
        raise SystemExit(answer.decode())
    samples = open_run(Path(json.loads(answer)["path"])).samples(record=0)
    expected = len(CHANNELS) * lasts * RATE
    return used.ru_utime + used.ru_stime, own, 1.0 - len(samples) / expected


def main() -> None:
    """A short and a long run, and what the seconds between took."""
    with ExitStack() as stack:
        free = [stack.enter_context(socket.create_server(("127.0.0.1", 0))) for _ in CHANNELS]
        ports = [int(one.getsockname()[1]) for one in free]
    with (
        tempfile.TemporaryDirectory() as name,
        subprocess.Popen([sys.executable, "-c", _SERVER, *map(str, ports)]) as server,
    ):
        try:
            time.sleep(2.0)
            folder = Path(name)
            (folder / "rig.yaml").write_text(rig_text(ports), encoding="utf-8")
            (folder / "rigctl.toml").write_text("", encoding="utf-8")
            short, short_own, _ = seconds_of_a_run(folder, SHORT)
            long, long_own, missed = seconds_of_a_run(folder, LONG)
        finally:
            server.kill()
    share = 100.0 * (long - short) / (LONG - SHORT)
    own = 100.0 * (long_own - short_own) / (LONG - SHORT)
    results = {
        "channels": sum(CHANNELS.values()),
        "percent of a core": share,
        "of it rigctl's process": own,
        "missed": missed,
    }
    rows = [
        ("per cent of one core", f"{share:.1f}", f"{ASKED:g}"),
        ("of it rigctl's process", f"{own:.1f}", ""),
        ("of it its four guards", f"{share - own:.1f}", ""),
        ("samples missed", f"{missed:.2%}", "0"),
    ]
    table("50 channels of four devices at 100 Hz", [("", "reached", "asked"), *rows])
    print(f"\nkept in {keep(FOLDER, results, 'pymodbus', name='load')}")


if __name__ == "__main__":
    main()
