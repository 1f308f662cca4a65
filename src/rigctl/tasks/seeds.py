"""Seeds that belong to a piece of work."""

from __future__ import annotations

import hashlib


def seed_of(seed: int, *name: str | int) -> int:
    """A seed of 63 bits for the piece of this name: the same wherever and whenever it is asked for.

    Neighbouring names, and neighbouring `seed`, have nothing in common.
    """
    text = "\x1f".join(map(str, (seed, *name)))
    return int.from_bytes(hashlib.sha256(text.encode("utf-8")).digest()[:8], "little") >> 1
