"""Every benchmark without external peers: ``make bench``."""

from __future__ import annotations

import subprocess
import sys

NAMES = (
    "campaign",
    "startup",
    "steps",
    "journal",
    "report",
    "importing",
    "engine",
    "analysis",
    "laws",
    "designing",
    "board",
    "protocols",
    "endings",
    "several_devices",
    "several_devices.load",
    "catalogue",
    "serve",
    "tasks",
    "storage",
    "survey",
)

for name in NAMES:
    print(f"\n=== {name}", flush=True)
    subprocess.run([sys.executable, "-m", f"benchmarks.{name}"], check=True)
