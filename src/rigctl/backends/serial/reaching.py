"""Opening the port of a bench for the first time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rigctl.backends.errors import BackendLost
from rigctl.backends.serial.port import Connect, Port, PortLost


@contextmanager
def reach(connect: Connect) -> Iterator[Port]:
    """Open a port for the block, which greets the bench; closed again if that fails.

    Raises
    ------
    BackendLost
        it cannot be reached.
    """
    port: Port | None = None
    try:
        port = connect()
        yield port
    except BaseException as error:
        if port is not None:
            port.close()
        if isinstance(error, PortLost):
            raise BackendLost(f"the bench cannot be reached: {error}") from None
        raise
