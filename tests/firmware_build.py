"""Where the board's program is, and whether it can be built here."""

from __future__ import annotations

import shutil

import pytest

from rigctl.files.shipped import shipped

FIRMWARE = shipped("firmware")
needs_compiler = pytest.mark.skipif(shutil.which("avr-gcc") is None, reason="needs avr-gcc ('make system')")
