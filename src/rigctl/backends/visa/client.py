"""The client of a VISA instrument: each line is a message, and one with a question mark is answered.

PyVISA communicates in the thread of a `ClientPort`, with pyvisa-py or an installed VISA.

A socket that is connected again, because an answer was missing, may lead to another instrument: it is sent
nothing before it has given the same answer to the identity query as the one before.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rigctl.backends.transport.client_port import ClientPort
from rigctl.backends.transport.port import PortLost
from rigctl.clock import Clock

#: the shortest time-out, ms; and the number of unsolicited lines after which contact counts as lost
_AT_ONCE = 1
_UNASKED = 100
#: longest answer, bytes; and the number of bytes read at a time if only a terminator ends it
_LONGEST = 4096
_PIECE = 256


def open_port(url: str, settings: Mapping[str, Any], clock: Clock) -> ClientPort:
    """Open the port of an `Address`: a VISA resource name.

    Its settings are ``library`` (``@py`` for pyvisa-py, or empty for an installed VISA), ``timeout`` in s,
    ``baud`` and ``frame`` of a serial line, the message terminators ``send_ends`` and ``reply_ends``, and
    ``identify``, the identity query, or None.
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
        self._settings = settings
        self._errors: tuple[type[BaseException], ...] = (Error, OSError, ValueError)
        self._io_error, self._time_out = VisaIOError, StatusCode.error_timeout
        try:
            self._manager: Any = ResourceManager(settings["library"])
        except self._errors as error:
            raise PortLost(f"{url}: {error}") from None
        self._instrument = self._opened()
        self._identify: str | None = settings.get("identify")
        self._identity: str | None = None  # its answer to that, once there is one
        self._unknown = False  # whether the socket was connected again, and has not been identified since

    def answer(self, line: str) -> str | None:
        """Return the instrument's answer to a message; None if there is none in time, or none is expected.

        Raises
        ------
        PortLost
            the connection is gone, or leads to another instrument, or to a silent one.
        """
        if self._unknown and line != self._identify:
            self._require_same()
        answer = self._exchange(line)
        if line == self._identify and answer is not None:
            if not self._unknown:  # a connection without an interruption: the first answer may have been late
                self._identity = answer
            self._unknown = answer != self._identity
        return answer

    def _require_same(self) -> None:
        """Identify the instrument behind a socket that was connected again."""
        found = self.answer(self._identify or "")
        if found is None:
            raise PortLost(f"{self._name}: connected again, it does not identify itself")
        if self._unknown:
            raise PortLost(f"{self._name}: connected again, another instrument answers: {found}")

    def _exchange(self, line: str) -> str | None:
        """Send a message, and read its answer as `answer`."""
        try:
            # Before each message: a late answer would be taken for the answer to this one, and all later ones
            # be shifted.
            self._discard()
            self._instrument.write(line)
            if "?" not in line:
                return None
            answer = self._message()
            if answer is not None:
                return answer.strip()
        except self._errors as error:
            # A time-out is an instrument that does not answer; any other error is a connection that is gone.
            if not (isinstance(error, self._io_error) and error.error_code == self._time_out):
                raise PortLost(f"{self._name}: {error}") from None
        try:
            self._forget()
        except self._errors as error:
            raise PortLost(f"{self._name}: {error}") from None
        return None

    def close(self) -> None:
        """Close the instrument."""
        self._instrument.close()
        self._manager.close()

    def _message(self) -> str | None:
        """Return the next message from the instrument; None if only the beginning of one has arrived.

        On a socket or a serial line only a terminator ends a message: PyVISA by itself would wait for it
        through any amount of data, and might return the beginning "1" of "12.5" as the whole message.

        Raises
        ------
        PortLost
            the message does not end.
        """
        ends = self._settings["reply_ends"] if self._of_bytes else ""
        data = self._instrument.read_bytes(
            _LONGEST, chunk_size=_PIECE if self._of_bytes else None, break_on_termchar=True
        )
        text = data.decode("ascii", "replace")
        if ends and text.endswith(ends):
            return str(text.removesuffix(ends))
        if len(data) >= _LONGEST:
            raise PortLost(f"{self._name}: its answer does not end within {_LONGEST} bytes, with {ends!r}")
        return None if ends else text

    @property
    def _of_bytes(self) -> bool:
        return self._is_socket or self._is_serial

    @property
    def _is_socket(self) -> bool:
        return self._name.upper().endswith("::SOCKET")

    @property
    def _is_serial(self) -> bool:
        return self._name.upper().startswith("ASRL")

    def _discard(self) -> None:
        """Discard unsolicited data, and late answers.

        On a socket or a serial line they would be taken for the answer to the next query, and all later
        answers would be shifted; other buses discard them.

        Raises
        ------
        PortLost
            the instrument does not stop sending.
        """
        if self._is_socket:
            self._read_until_silent(_AT_ONCE)
        elif self._is_serial:
            self._flush()

    def _flush(self) -> None:
        """Discard what has arrived on a serial line."""
        from pyvisa.constants import BufferOperation

        self._instrument.flush(BufferOperation.discard_read_buffer)

    def _read_until_silent(self, milliseconds: float) -> None:
        """Read and discard until nothing has arrived for `milliseconds`.

        Raises
        ------
        PortLost
            the instrument does not stop sending.
        """
        patience = self._instrument.timeout
        self._instrument.timeout = milliseconds
        try:
            for _ in range(_UNASKED):
                self._message()
        except self._io_error as error:
            if error.error_code != self._time_out:
                raise
            return
        finally:
            self._instrument.timeout = patience
        raise PortLost(f"{self._name}: it sends without being asked")

    def _opened(self) -> Any:
        from pyvisa.constants import Parity, StopBits

        settings = self._settings
        milliseconds = round(1e3 * settings["timeout"])
        try:
            instrument: Any = self._manager.open_resource(
                self._name,
                open_timeout=milliseconds,
                timeout=milliseconds,
                write_termination=settings["send_ends"],
                read_termination=settings["reply_ends"],
            )
            if self._is_serial:
                bits, parity, stops = settings["frame"]
                instrument.baud_rate, instrument.data_bits = settings["baud"], int(bits)
                instrument.parity = {"N": Parity.none, "E": Parity.even, "O": Parity.odd}[parity]
                instrument.stop_bits = StopBits.one if stops == "1" else StopBits.two
        except Exception as error:  # PyVISA-py raises none of its own where Windows refuses a connection
            if not isinstance(error, self._errors) and type(error) is not Exception:
                raise
            raise PortLost(f"{self._name}: {error}") from None
        return instrument

    def _forget(self) -> None:
        """Prevent a late answer from being taken for the answer to a later query.

        A socket is reconnected, since a new connection does not receive it. A serial line is read until it
        has been silent for as long as an answer may take. Other buses have a command that clears the device.
        """
        if self._is_socket:
            self._instrument.close()
            self._instrument = self._opened()
            self._unknown = self._identity is not None
        elif self._is_serial:
            self._read_until_silent(self._instrument.timeout)
        else:
            self._instrument.clear()
