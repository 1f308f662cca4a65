"""The jitter of a loop on a fast device, alone and beside three slow ones.

``python -m benchmarks.control_loop.beside_slow [PAIRS [SECONDS [HERTZ]]]``

Whole commands on Modbus servers (pymodbus, in a process of their own): a loop at 50 Hz on one device, which
is the only one of its rig, or has three beside it that answer after 0.3 s. Both in turn, the first of each
pair alternating, so that whatever else the computer does falls on both. What counts is the difference.
"""

from __future__ import annotations

import json
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

from benchmarks.record import keep, table
from rigctl.dataset import open_run

PAIRS = int(sys.argv[1]) if len(sys.argv) > 1 else 6
SECONDS = float(sys.argv[2]) if len(sys.argv) > 2 else 30.0
RATE = float(sys.argv[3]) if len(sys.argv) > 3 else 50.0
ASKED = 0.5  # ms, by which the 99th percentile may be larger
SLOW = ("slow_1", "slow_2", "slow_3")
SHOWN = ("jitter_p50", "jitter_p99", "latency_p99")

_SERVER = """
import asyncio, sys
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

def device(delay):
    async def act(*_):
        await asyncio.sleep(delay)
    bits = [SimData(0, count=16, values=False, datatype=DataType.BITS)]
    registers = [SimData(0, count=16, values=1000, datatype=DataType.REGISTERS)]
    return SimDevice(1, (bits, bits, registers, registers), **({"action": act} if delay else {}))

async def main():
    servers = [
        ModbusTcpServer(device(0.3 if number else 0.0), address=("127.0.0.1", int(port)))
        for number, port in enumerate(sys.argv[1:])
    ]
    await asyncio.gather(*(server.serve_forever() for server in servers))

asyncio.run(main())
"""

_DEVICE = """{kind: modbus, port: "127.0.0.1:%d", modbus: {timeout: 2 s, watchdog: 10 s%s,
      channels: {%s: {table: input, address: 0}}, actuators: {%s: {table: holding, address: 1}}}}"""


def rig_text(ports: list[int], slow: bool) -> str:
    """The rig file of the one device, or of all four."""
    fast = _DEVICE % (ports[0], "", "v", "u")
    if not slow:
        reached = f"backend: {fast}"
    else:
        others = [
            f"  {name}: {_DEVICE % (port, ', fastest: 1 Hz', f'v_{name}', f'u_{name}')}"
            for name, port in zip(SLOW, ports[1:], strict=True)
        ]
        reached = "\n".join(["devices:", f"  fast: {fast}", *others])
    names = {"": "fast", **{f"_{name}": name for name in SLOW}} if slow else {"": ""}
    of = {suffix: f"device: {device}, " if device else "" for suffix, device in names.items()}
    channels = [f"  v{suffix}: {{{part}unit: V, quantity: voltage}}" for suffix, part in of.items()]
    actuators = [
        f'  u{suffix}: {{{part}kind: level, unit: "%", low: 0 %, high: 100 %}}' for suffix, part in of.items()
    ]
    safe = ", ".join(f"u{suffix}: 0 %" for suffix in of)
    lines = ["name: loop", reached, "channels:", *channels, "actuators:", *actuators]
    return "\n".join([*lines, f"safe_state: {{{safe}}}", "stale_after: 20 s", ""])


def loop(folder: Path, ports: list[int], slow: bool) -> dict[str, float]:
    """One run, and what it has stored of its loop, ms."""
    (folder / "rig.yaml").write_text(rig_text(ports, slow), encoding="utf-8")
    (folder / "loop.yaml").write_text(
        "procedure: loop\nrig: rig.yaml\nsteps:\n"
        f"  - record: {{name: loop, rate: {RATE:g} Hz, most_missing: 100 %}}\n    do:\n"
        "      - control: {actuator: u, channel: v, to: 1001 V, gain: 1 %/V, integral: 0.1 %/(V*s),\n"
        f"          rate: {RATE:g} Hz, for: {SECONDS:g} s}}\n",
        encoding="utf-8",
    )
    command = [sys.executable, "-m", "rigctl", "run", "loop.yaml", "--json"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(done.stdout + done.stderr)
    measures = open_run(Path(json.loads(done.stdout)["path"])).record(0).measures
    return {key: 1e3 * measures[f"control_{key}"] for key in SHOWN}


def main() -> None:
    """The pairs, and the medians of their differences."""
    with ExitStack() as stack:
        free = [stack.enter_context(socket.create_server(("127.0.0.1", 0))) for _ in range(1 + len(SLOW))]
        ports = [int(one.getsockname()[1]) for one in free]
    runs: dict[bool, list[dict[str, float]]] = {False: [], True: []}
    with (
        tempfile.TemporaryDirectory() as name,
        subprocess.Popen([sys.executable, "-c", _SERVER, *map(str, ports)]) as server,
    ):
        try:
            time.sleep(2.0)
            (Path(name) / "rigctl.toml").write_text("", encoding="utf-8")
            for pair in range(PAIRS):
                for slow in (pair % 2 == 0, pair % 2 == 1):
                    runs[slow].append(loop(Path(name), ports, slow))
        finally:
            server.kill()
    rows = []
    results: dict[str, object] = {"pairs": PAIRS, "s": SECONDS, "Hz": RATE}
    for key in SHOWN:
        alone, beside = ([run[key] for run in runs[slow]] for slow in (False, True))
        by = [more - less for less, more in zip(alone, beside, strict=True)]
        results[key] = {"alone": alone, "beside three slow ones": beside}
        asked = f"+{ASKED:g}" if key == "jitter_p99" else ""
        middle = [f"{statistics.median(values):.3f}" for values in (alone, beside)]
        rows.append((f"{key}, ms", *middle, f"{statistics.median(by):+.3f}", asked))
    heading = ("", "alone", "beside three slow ones", "by", "asked")
    table(f"a closed loop at {RATE:g} Hz on a fast device, medians", [heading, *rows])
    print(f"\nkept in {keep(FOLDER, results, 'pymodbus', name='beside_slow')}")


FOLDER = Path(__file__).parent

if __name__ == "__main__":
    main()
