"""Selection of the workers that carry out tasks."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Final, Literal

from rigctl.errors import RigctlError

#: prefix of the address of a temporary cluster on this computer
LOCAL: Final = "local:"
_ADDRESSES: Final = ("tcp://", "tls://", "ucx://", "ws://", "wss://")


@dataclass(frozen=True)
class Workers:
    """Workers of `map_tasks`.

    Attributes
    ----------
    count: number of workers on this computer; None for one on each core.
    kind: processes, or threads for work that waits or releases the interpreter lock.
    cluster: address of a Dask scheduler, ``tcp://HOST:8786``, or ``local:8`` for a temporary cluster of eight
        processes on this computer; `count` is then ignored.
    """

    count: int | None = None
    kind: Literal["processes", "threads"] = "processes"
    cluster: str | None = None

    def __post_init__(self) -> None:
        if self.cluster is not None:
            _check(self.cluster)

    def for_pieces(self, pieces: int) -> int:
        """Number of local workers for a number of pieces."""
        return max(1, min(self.count or os.cpu_count() or 1, pieces))

    @property
    def local_count(self) -> int | None:
        """Number of processes of a temporary local cluster; None for any other."""
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
