"""The served page: ``python -m benchmarks.serve [--minutes 1] [--pairs 3] [--runs 20000] [--no-browser]``.

A run of eight channels at 100 Hz in real time is watched by two sockets and a browser. Latency is from a
sample's time stamp to its arrival, and to its drawing. Runs with and without viewers alternate, and the delay
of each sample from its time stamp to its storage is compared. Pages of the catalogue are requested over HTTP,
with the given number of runs. The size of the extra is that of a zip file like a wheel.
"""

from __future__ import annotations

import argparse
import http.client
import io
import json
import os
import re
import struct
import subprocess
import sys
import tempfile
import threading
import time
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import files
from pathlib import Path
from typing import Any

import numpy as np
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from benchmarks.catalogue.__main__ import write_runs
from benchmarks.record import keep, median_seconds, table

CHANNELS = 8
_CHANNEL = "  c{}: {{quantity: pressure, unit: bar, noise: 0.1 bar, range: [-10 bar, 100 bar]}}\n"
RIG = f"""\
name: eight channels
backend: {{kind: simulated}}
channels:
{"".join(_CHANNEL.format(number) for number in range(CHANNELS))}actuators:
  heater: {{kind: switch}}
safe_state: {{heater: off}}
"""
ADDED = ("starlette", "uvicorn", "websockets", "anyio", "h11", "idna")
WINDOW = 60.0
#: drawings since the one with a sample of this time
DRAWN = "seen => import('/assets/live.js').then(live => live.drawnAt.filter(one => one[0] > seen))"


@contextmanager
def server(project: Path) -> Iterator[tuple[str, str, int, float]]:
    """Base address, cookie, process and seconds until the address was printed."""
    began = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-m", "rigctl", "serve", str(project), "--no-browser", "--port", "0"],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    assert process.stdout is not None
    address = ""
    for line in process.stdout:
        if found := re.search(r"http://\S+#\S+", line):
            address = found.group()
            break
    started = time.perf_counter() - began
    base, _, token = address.partition("#")
    base = base.rstrip("/")
    line = http.client.HTTPConnection(base.partition("//")[2])
    line.request("POST", "/api/session", json.dumps({"token": token}), {"Origin": base})
    cookie = str(line.getresponse().headers["Set-Cookie"]).partition(";")[0]
    line.close()
    try:
        yield address, cookie, process.pid, started
    finally:
        process.terminate()
        process.wait(20)
        process.stdout.close()


class Socket(threading.Thread):
    """A viewer: notes when each sample arrives, by the wall clock."""

    def __init__(self, base: str, cookie: str, name: str) -> None:
        super().__init__(daemon=True)
        self.arrived: list[tuple[float, float]] = []
        self.going = True
        self._address = f"ws://{base.partition('//')[2]}/api/live/stream?viewer={name}"
        self._headers = {"Cookie": cookie}
        self._base = base

    def run(self) -> None:
        with suppress(ConnectionClosed):  # the server ended first
            self._listen()

    def _listen(self) -> None:
        with connect(self._address, origin=self._base, additional_headers=self._headers) as socket:
            socket.send("{}")
            begun = False
            while self.going:
                try:
                    message = socket.recv(1.0)
                except TimeoutError:
                    continue
                now = time.time()
                if isinstance(message, str):
                    said = json.loads(message)
                    if said["kind"] == "runs" and said["runs"] and not begun:
                        begun = True
                        wanted = {"run": said["runs"][0], "window": WINDOW, "width": 4000}
                        socket.send(json.dumps(wanted))
                    continue
                rows, columns, _, anew, first = struct.unpack("<HHHHd", message[:16])
                if anew or not rows:
                    continue  # earlier messages are not new
                times = np.frombuffer(message[16:], "<f4").reshape(columns, rows)[0].astype(float) + first
                self.arrived += [(float(time_), now) for time_ in times]


@contextmanager
def browser(address: str) -> Iterator[Any]:
    """The page Live in Chromium."""
    from playwright.sync_api import sync_playwright

    base, _, token = address.partition("#")
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=os.environ.get("CHROMIUM", "/usr/bin/chromium"),
            args=["--no-sandbox", "--disable-gpu"],
        )
        page = chromium.new_page(viewport={"width": 1400, "height": 900})
        page.goto(f"{base}live#{token}")
        yield page
        chromium.close()


def carried_out(project: Path, seconds: float) -> tuple[subprocess.Popen[bytes], Path]:
    """A run in progress, and the file that it will write."""
    output = project / f"handed-{time.time():.0f}.npy"
    command = [sys.executable, "-m", "benchmarks.serve.watched_run", str(seconds), str(output)]
    root = str(Path(__file__).resolve().parents[2])
    path = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH", ""))))
    return subprocess.Popen(command, cwd=project, env={**os.environ, "PYTHONPATH": path}), output


def lateness(handed: np.ndarray) -> np.ndarray:
    """Delay of each sample's storage relative to the fastest, s."""
    late = handed[:, 1] - handed[:, 0]
    return late - late.min()


def memory(pid: int) -> float:
    """Resident memory, MB; NaN if unknown."""
    try:
        found = re.search(r"VmRSS:\s+(\d+)", Path(f"/proc/{pid}/status").read_text(encoding="ascii"))
    except OSError:
        return float("nan")
    return int(found.group(1)) / 1e3 if found else float("nan")


class Meter:
    """Samples server memory and the browser's drawings once a second, and browser memory rarely."""

    def __init__(self, process: subprocess.Popen[bytes], pid: int) -> None:
        self._process = process
        self._pid = pid
        self.sizes: list[float] = []
        self.heaps: list[float] = []
        self.drawn: list[list[float]] = []

    def until_over(self, page: Any = None) -> None:
        session = page.context.new_cdp_session(page) if page is not None else None
        next_heap = time.monotonic() + 15.0
        while self._process.poll() is None:
            time.sleep(1.0)
            self.sizes.append(memory(self._pid))
            if session is None:
                continue
            seen = self.drawn[-1][0] if self.drawn else 0.0
            self.drawn += page.evaluate(DRAWN, seen)
            if time.monotonic() > next_heap:
                next_heap += 15.0
                session.send("HeapProfiler.collectGarbage")
                self.heaps.append(session.send("Runtime.getHeapUsage")["usedSize"] / 1e6)

    def told(self) -> dict[str, float]:
        fifth = max(len(self.sizes) // 5, 1)
        found = {
            "memory of the server, a fifth on [MB]": float(np.median(self.sizes[fifth : 2 * fifth])),
            "memory of the server, at the end [MB]": float(np.median(self.sizes[-fifth:])),
        }
        if len(self.heaps) > 2:
            found["memory of the page, a fifth on [MB]"] = self.heaps[len(self.heaps) // 5]
            found["memory of the page, at the end [MB]"] = self.heaps[-1]
        return found


def watch(project: Path, minutes: float, *, with_browser: bool) -> dict[str, float]:
    """Latency and memory while a long run is watched by two sockets and a browser."""
    with server(project) as (address, cookie, pid, started):
        base = address.partition("/#")[0]
        sockets = [Socket(base, cookie, f"viewer-{n}") for n in range(2)]
        for each in sockets:
            each.start()
        process, output = carried_out(project, 60.0 * minutes)
        meter = Meter(process, pid)
        if with_browser:
            with browser(address) as page:
                meter.until_over(page)
        else:
            meter.until_over()
        for each in sockets:
            each.going = False
    handed = np.load(output)
    began = float((handed[:, 1] - handed[:, 0]).min())  # the wall clock at the run's zero
    told = {"start to address printed [s]": started, "samples": float(len(handed))}
    arrived = np.array([one for each in sockets for one in each.arrived])
    ways = {"sample to socket": arrived, "newest sample drawn": np.array(meter.drawn)}
    for name, pairs_ in ways.items():
        if len(pairs_):
            late = (pairs_[:, 1] - pairs_[:, 0] - began)[pairs_[:, 0] > 5.0]  # while the page opens
            told[f"{name}, median [ms]"] = 1e3 * float(np.median(late))
            told[f"{name}, 99 % [ms]"] = 1e3 * float(np.quantile(late, 0.99))
    return told | meter.told()


def pairs(project: Path, count: int, seconds: float) -> dict[str, float]:
    """Delays of the samples without viewers and with four, alternately."""
    alone, watched = [], []
    for _ in range(count):
        process, output = carried_out(project, seconds)
        process.wait()
        alone.append(lateness(np.load(output)))
        with server(project) as (address, cookie, _, _):
            sockets = [Socket(address.partition("/#")[0], cookie, f"viewer-{n}") for n in range(4)]
            for each in sockets:
                each.start()
            process, output = carried_out(project, seconds)
            process.wait()
            watched.append(lateness(np.load(output)))
            for each in sockets:
                each.going = False
    told = {}
    for name, share in (("median", 0.5), ("99 %", 0.99), ("99.9 %", 0.999), ("latest", 1.0)):
        apart = [
            np.quantile(with_, share) - np.quantile(without, share)
            for without, with_ in zip(alone, watched, strict=True)
        ]
        told[f"lateness, {name}, alone [ms]"] = 1e3 * float(
            np.median([np.quantile(one, share) for one in alone])
        )
        told[f"lateness, {name}, watched minus alone [ms]"] = 1e3 * float(np.median(apart))
    return told


def catalogue(folder: Path, count: int) -> dict[str, float]:
    """Pages of the catalogue over HTTP, with the given number of runs."""
    project = folder / "many"
    project.mkdir()
    write_runs(project / "runs", count)
    told = {}
    with server(project) as (address, cookie, _, _):
        base = address.partition("/#")[0]
        line = http.client.HTTPConnection(base.partition("//")[2], timeout=3600)

        def ask(query: str) -> dict[str, Any]:
            line.request("GET", f"/api/runs?{query}", headers={"Cookie": cookie})
            answer = json.loads(line.getresponse().read())
            assert answer["all"] == count, answer
            return dict(answer)

        began = time.perf_counter()
        ask("")
        told["runs"] = float(count)
        told["first page ever, the index is made [s]"] = time.perf_counter() - began
        for name, query in (
            ("newest page", ""),
            ("a page in the middle", f"first={count // 2}"),
            ("sorted by records", "sort=records"),
            ("words looked for", "search=bench+C+stroke"),
            ("a condition", "where=records+%3E+30+AND+rig+%3D+'bench+B'"),
        ):
            told[f"{name} [s]"] = median_seconds(lambda query=query: ask(query), runs=5)  # type: ignore[misc]
        line.close()
    return told


def added() -> dict[str, float]:
    """Size of the extra and the page in an installation, zipped as in a wheel, MB."""
    told = {}
    own = Path(__file__).resolve().parents[2] / "src" / "rigctl" / "web"
    for name in (*ADDED, "rigctl.web"):
        kept = io.BytesIO()
        with zipfile.ZipFile(kept, "w", zipfile.ZIP_DEFLATED) as wheel:
            if name == "rigctl.web":
                paths = [path for path in own.rglob("*") if path.is_file()]
            else:
                paths = [Path(str(one.locate())) for one in files(name) or ()]
            for path in paths:
                if path.is_file() and "__pycache__" not in path.parts:
                    wheel.write(path, str(path))
        told[f"{name} [MB]"] = len(kept.getvalue()) / 1e6
    told["together [MB]"] = sum(told.values())
    return told


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=1.0, help="how long a run is watched")
    parser.add_argument("--pairs", type=int, default=3, help="of runs without viewers and with")
    parser.add_argument("--seconds", type=float, default=15.0, help="of each run of a pair")
    parser.add_argument("--runs", type=int, default=20_000, help="in the catalogue")
    parser.add_argument("--no-browser", action="store_true", help="sockets alone")
    asked = parser.parse_args()
    results: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_STATE_HOME"] = os.environ["XDG_CACHE_HOME"] = folder
        project = Path(folder) / "bench"
        project.mkdir()
        (project / "rigctl.toml").touch()
        (project / "rig.yaml").write_text(RIG, encoding="utf-8")
        results["what is added"] = added()
        results["a run with viewers and without"] = pairs(project, asked.pairs, asked.seconds)
        watched = watch(project, asked.minutes, with_browser=not asked.no_browser)
        results[f"watched for {asked.minutes:g} min"] = watched
        results["the catalogue"] = catalogue(Path(folder), asked.runs)
    for title, found in results.items():
        table(title, [("what", "value"), *((key, f"{value:.4g}") for key, value in found.items())])
    keep(Path(__file__).parent, results, *ADDED)


if __name__ == "__main__":
    main()
