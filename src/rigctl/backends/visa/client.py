"""The client of an instrument behind VISA: each line is a message; one with a question mark is answered.

PyVISA speaks to the instrument, in the thread of a `ClientPort`, with pyvisa-py or with an installed VISA.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rigctl.backends.transport.client_port import ClientPort
from rigctl.backends.transport.port import PortLost
from rigctl.clock import Clock


def open_port(url: str, settings: Mapping[str, Any], clock: Clock) -> ClientPort:
    """The port of an `Address`: a VISA resource name.

    Its settings are ``library`` (``@py`` for pyvisa-py, or empty for an installed VISA), ``timeout`` in s,
    ``baud`` of a serial line, and what ends messages: ``send_ends`` and ``reply_ends``.
    """
    return ClientPort(url, lambda: VisaClient(url, settings), clock)


class VisaClient:
    """One open instrument.

    Raises
    ------
    PortLost
        it cannot be opened.
    """

    def __init__(self, url: str, settings: Mapping[str, Any]) -> None:
        from pyvisa import ResourceManager
        from pyvisa.constants import StatusCode
        from pyvisa.errors import Error, VisaIOError

        self._name = url
        self._errors: tuple[type[BaseException], ...] = (Error, OSError, ValueError)
        self._io_error, self._time_out = VisaIOError, StatusCode.error_timeout
        try:
            self._manager: Any = ResourceManager(settings["library"])
            self._instrument: Any
            self._instrument = self._manager.open_resource(
                url,
                open_timeout=round(1e3 * settings["timeout"]),
                timeout=round(1e3 * settings["timeout"]),
                write_termination=settings["send_ends"],
                read_termination=settings["reply_ends"],
            )
            if url.upper().startswith("ASRL"):
                self._instrument.baud_rate = settings["baud"]
        except self._errors as error:
            raise PortLost(f"{url}: {error}") from None

    def answer(self, line: str) -> str | None:
        """The instrument's answer to a message; None when it gives none in time, or none was asked for."""
        try:
            self._instrument.write(line)
            return str(self._instrument.read()).strip() if "?" in line else None
        except self._errors as error:
            if isinstance(error, self._io_error) and error.error_code == self._time_out:
                return None
            raise PortLost(f"{self._name}: {error}") from None

    def close(self) -> None:
        """Let it go."""
        self._instrument.close()
        self._manager.close()
