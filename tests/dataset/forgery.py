"""Runs as a forger makes them, who can compute checksums too."""

from __future__ import annotations

import hashlib
import json
from typing import Any


def sealed(info: dict[str, Any]) -> str:
    """A run.json with the checksum that the format's page describes."""
    said = {key: value for key, value in info.items() if key != "checksum"}
    text = json.dumps(said, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return json.dumps({**said, "checksum": hashlib.sha256(text.encode("ascii")).hexdigest()})
