"""Seeds derived from the name of a task."""

from __future__ import annotations

import hashlib


def seed_of(seed: int, *name: str | int) -> int:
    """A seed of 63 bits for the task with this name: a hash, and so reproducible on any computer.

    Seeds for similar names, or from neighbouring values of `seed`, are unrelated.
    """
    text = "\x1f".join(map(str, (seed, *name)))
    return int.from_bytes(hashlib.sha256(text.encode("utf-8")).digest()[:8], "little") >> 1
