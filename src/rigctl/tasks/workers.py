"""Where pieces of work are carried out."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Final, Literal

from rigctl.errors import RigctlError

#: the address of a cluster that is made for one command, on this computer
LOCAL: Final = "local:"
_ADDRESSES: Final = ("tcp://", "tls://", "ucx://", "ws://", "wss://")


@dataclass(frozen=True)
class Workers:
    """Who works.

    Attributes
    ----------
    count: so many at once, on this computer; None for one on each core.
    kind: processes, or threads of this process: for work that waits, or leaves Python's lock alone.
    cluster: a scheduler of Dask's, ``tcp://HOST:8786``, or ``local:8`` for a cluster of eight processes that
        is made here; then `count` is the cluster's.
    """

    count: int | None = None
    kind: Literal["processes", "threads"] = "processes"
    cluster: str | None = None

    def __post_init__(self) -> None:
        if self.cluster is not None:
            _check(self.cluster)

    def for_pieces(self, pieces: int) -> int:
        """How many are worth starting here for so many pieces."""
        return max(1, min(self.count or os.cpu_count() or 1, pieces))

    @property
    def local_count(self) -> int | None:
        """How many processes a cluster that is made here has; None for one that is elsewhere."""
        if self.cluster is None or not self.cluster.startswith(LOCAL):
            return None
        return int(self.cluster.removeprefix(LOCAL))


def _check(address: str) -> None:
    count = address.removeprefix(LOCAL)
    if address.startswith(LOCAL) and count.isdecimal() and int(count) > 0:
        return
    if address.startswith(_ADDRESSES):
        return
    raise RigctlError(
        "no cluster's address",
        value=address,
        expected="tcp://HOST:PORT of a Dask scheduler, or local:N for N processes on this computer",
    )
