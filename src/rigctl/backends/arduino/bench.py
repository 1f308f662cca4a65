"""The backend for rigctl's own board.

In: the board's lines (docs/reference/board-protocol.md), through a `Port`. Out: samples with the board's
own times, and exact times of switches. In contrast to a device that is polled, the board streams samples
by itself, answers tagged queries in between, times pulses, and switches off when it has not heard of the
host for 1.5 s.

The parts, each with one concern: `line` (tags, checksums), `receiver` (the stream), `clock_map` (the
board's microseconds on the bench's clock), `switching` (commands and the time at which they acted),
`heartbeat` (sign of life, and whether the board still answers), `regulation` (the closed loop on the
board). All of them run on the caller's thread; several queries may be open at once.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass

from rigctl.backends.arduino.board import Board, trip_causes
from rigctl.backends.arduino.handshake import handshake
from rigctl.backends.arduino.heartbeat import Heartbeat
from rigctl.backends.arduino.line import Line
from rigctl.backends.arduino.read_back import reading_back, still
from rigctl.backends.arduino.receiver import Receiver
from rigctl.backends.arduino.regulation import Regulation, cannot_regulate
from rigctl.backends.arduino.switching import Switching
from rigctl.backends.arduino.translation import Translation
from rigctl.backends.arduino.wiring import Wiring
from rigctl.backends.commands import driven_outputs
from rigctl.backends.errors import BenchTripped, OutOfReach
from rigctl.backends.protocol import CommandReceipt, PendingCommand
from rigctl.backends.transport.bench import PortBench
from rigctl.backends.transport.conversation import ActiveConversation, Conversation, carry_through
from rigctl.backends.transport.port import Connect, NoAnswer, NotConfirmed, Port, PortLost, Refused
from rigctl.backends.transport.reconnection import DeviceIdentification
from rigctl.clock import Clock
from rigctl.errors import ExitCode, RigctlError
from rigctl.plan.loop import LoopSettings, LoopState
from rigctl.rig import Rig
from rigctl.rig.rates import BOARD_RATES

HOST_SILENT = "host silent"  #: the trip whose cause ends when a host connects
_SAFE_ANSWER, _SAFE_TRIES = 0.1, 8  # s, attempts: outputs are safe within 1 s even if lines are lost


@dataclass(frozen=True, slots=True)
class _Order:
    """A command that the board has not answered yet; `asked_for`: whether the caller waits for the answer."""

    pending: PendingCommand
    underway: ActiveConversation[None]
    asked_for: bool


class ArduinoBench(PortBench[Board]):
    """A `Backend` for rigctl's own board, on any `Port`.

    Parameters
    ----------
    rig: the channels and actuators.
    clock: the clock for waits.
    connect: opens the port; called again after a loss.
    wiring: what is connected where.
    kind: ``serial`` or ``emulated``, for the identity.
    baud: bits per second.
    patience: s allowed for a board that restarts when its port is opened.
    reconnect: s allowed for a lost board to return.
    clear_trips: whether earlier latched trips are cleared when the bench is opened; see
        docs/decisions/0011-which-trips-are-cleared-automatically.md.
    by_hand: called when the operator turns something, if the operator is emulated too.
    """

    timed = True
    device = "board"
    without_host = "the board switches off by itself 1.5 s after it last heard of rigctl, if it still works"

    def __init__(
        self,
        rig: Rig,
        clock: Clock,
        connect: Connect,
        wiring: Wiring,
        *,
        kind: str,
        baud: int,
        patience: float = 5.0,
        reconnect: float | None = None,
        clear_trips: bool = False,
        identity: Mapping[str, str] | None = None,
        by_hand: Callable[[str, float], None] | None = None,
    ) -> None:
        super().__init__(
            rig, clock, connect, kind=kind, reconnect=reconnect, identity=identity, by_hand=by_hand
        )
        self._translation = Translation(rig, wiring)
        self._baud = baud
        self._patience = patience
        self._clear_trips = clear_trips
        self._heartbeat: Heartbeat | None = None
        self._receiver = Receiver(self._translation, clock, self._outbox)
        self._switching = Switching(self._translation, self._outbox, clock)
        self._regulation = Regulation(self._translation, self._receiver, clock)
        self._orders: dict[str, _Order] = {}
        self._streaming: ActiveConversation[None] | None = None
        self._on: Mapping[str, float] = {}  # outputs that were read as not safe, SI

    @property
    def outputs_read(self) -> frozenset[str]:
        """All driven outputs: the board reports them when it was made safe."""
        return driven_outputs(self._rig)

    @property
    def outputs_answered(self) -> frozenset[str]:
        """All driven outputs, since the board answers every command."""
        return driven_outputs(self._rig)

    @property
    def _may_be_on(self) -> Mapping[str, float]:
        return self._on

    @property
    def _failure(self) -> str:
        return f"the board has tripped: {self._receiver.tripped}" if self._receiver.tripped else ""

    # --- identification -----------------------------------------------------------------------------------

    def _identify(self, port: Port, *, again: bool) -> DeviceIdentification[Board]:
        line = Line(port, self.clock, self._baud)
        return DeviceIdentification(port, line.take, self._begin(line, again=again))

    def _begin(self, line: Line, *, again: bool) -> Conversation[Board]:
        """Identify the board, make it safe, read its trips, synchronise the clocks and start the stream."""
        board = yield from handshake(line, self._patience)
        # 1. After a loss: the same board, in all that is known of it but its port, which may have another
        #   name now.
        for name, known in self.identity.items():
            if board.identity.get(name, known) != known and name != "port":
                raise RigctlError(
                    "another board answers than before", value=board.identity[name], expected=known
                )
        try:
            # 2. Outputs safe, before its stream or its clock are looked at.
            yield from self._making_safe(board)
        except Refused as error:
            raise NotConfirmed(str(error)) from None
        # 3. No stream while the clock is learned: its lines would delay the answers that are timed.
        yield from board.asking("STRM 0")
        yield from board.learning_clock(8)
        # 4. What came before belongs to another session. Its times would be converted by the new clock map.
        board.line.forget()
        self.identity = {**self.identity, **board.identity}
        self._receiver.tripped, self._failure_announced = "", False
        self._regulation.forget()
        self._note_safe()
        try:
            yield from self._clearing_trips(board)
        except BenchTripped as tripped:
            # 5. Trips. At the opening one ends it; on a board that came back the run is told, and ends as by
            #   a trip.
            if not again:
                raise
            self._receiver.tripped = tripped.causes  # reachable, but no longer working
            self._reconnection.why = tripped.what
            self._outbox.notice("alarm", tripped.what)
        else:
            # 6. Sampling as before the loss.
            yield from self._stream(board)
        self._heartbeat = Heartbeat(board, self.clock)
        return board

    def _clearing_trips(self, board: Board) -> Conversation[None]:
        """Clear a trip due to a silent host, since a host is back; a person must clear all others."""
        before = yield from board.asking_trips()
        if not before:
            return
        causes = ", ".join(trip_causes(before))
        if not (self._clear_trips or trip_causes(before) == [HOST_SILENT]):
            raise BenchTripped(causes)
        try:
            yield from board.asking("SYST:TRIP:CLE")
        except Refused:
            raise RigctlError(
                f"the board has tripped, and the cause lasts: {causes}", exit_code=ExitCode.FAILED
            ) from None
        self._outbox.notice("note", f"the board had tripped before: {causes}; cleared")

    # --- making safe --------------------------------------------------------------------------------------

    def _making_safe(self, board: Board) -> Conversation[None]:
        # One command for all outputs first; those whose safe value is not off are set after it.
        yield from board.line.asking("OUTP:SAFE", _SAFE_ANSWER, _SAFE_TRIES)
        for text in self._translation.safe_texts():
            yield from board.asking(text)
        self._on = yield from reading_back(
            board, self._translation, self._rig, self.clock, _SAFE_ANSWER, _SAFE_TRIES
        )
        if self._on:
            raise still(self._rig, self._on)

    def _make_safe(self, board: Board) -> None:
        carry_through(self._making_safe(board), board.line.take)
        self._regulation.forget()
        self._receiver.take(board)

    def _safe_for_closing(self, board: Board) -> None:
        carry_through(self._making_safe(board), board.line.take)
        board.line.ask("STRM 0")

    # --- samples ------------------------------------------------------------------------------------------

    def _check_rate(self, rate: float) -> None:
        slowest, fastest = BOARD_RATES
        if not slowest <= rate <= fastest:
            raise RigctlError(
                "the board cannot sample like this",
                value=f"{rate:g} Hz",
                expected=f"{slowest:g} to {fastest:g} Hz",
            )

    def _begin_sampling(self) -> None:
        if self._contact is None:  # a board that reconnects starts its stream by itself
            return
        try:
            self._streaming = ActiveConversation(self._stream(self._contact))
        except PortLost as error:
            self._lose(error)

    def _stream(self, board: Board) -> Conversation[None]:
        """Start the board's stream at the current rate."""
        self._receiver.restarting = True
        try:
            answer = yield from board.line.asking(f"STRM {self._rate or self._rig.monitor_rate:.3f}")
        except Refused as error:
            raise NoAnswer(str(error)) from None
        self._receiver.restart(board, answer.readings_before)
        self._receiver.wanted = self._rate > 0.0

    # --- commands -----------------------------------------------------------------------------------------

    def _put(self, actuator: str, value: float, duration: float | None, *, asked_for: bool) -> PendingCommand:
        board = self._check_reach()
        self._ends.pop(actuator, None)
        self._drop_order(actuator, "another command came before the board had answered")
        self._receiver.take(board)  # earlier events are not caused by this command
        pending = self._pending(actuator, value)
        if actuator == self._regulation.actuator:  # this ends the board's loop
            self._regulation.forget()
        return self._order(pending, self._carry_out(board, pending, duration), asked_for=asked_for)

    def _order(
        self, pending: PendingCommand, conversation: Conversation[None], *, asked_for: bool
    ) -> PendingCommand:
        """Start a command; raises `OutOfReach`."""
        try:
            underway = ActiveConversation(conversation)
        except PortLost as error:
            self._doubt(pending)
            self._lose(error)
            raise OutOfReach(f"contact with the board is lost: {error}") from None
        self._orders[pending.actuator] = _Order(pending, underway, asked_for)
        return pending

    def _carry_out(self, board: Board, pending: PendingCommand, duration: float | None) -> Conversation[None]:
        """Switch an output, and record the board's answer."""
        actuator, value = pending.actuator, pending.value
        try:
            receipt = yield from self._switching.switch(board, actuator, value, duration)
        except Refused as error:
            # The board may have refused because it has tripped: the message then names the cause.
            hint = yield from _querying_trip(board)
            pending.trouble = RigctlError(str(error), hint=hint, exit_code=ExitCode.FAILED)
            return
        self._outbox.commanded[actuator] = value
        if duration is not None and not self._translation.times_pulse(actuator, duration):
            self._ends[actuator] = receipt.time + duration
        pending.receipt = receipt

    def _go_on(self) -> None:
        """Continue the query in progress; raises `PortLost`."""
        if self._streaming is not None:
            self._streaming.go_on()
            if self._streaming.over:
                self._streaming = None
        for actuator, order in list(self._orders.items()):
            order.underway.go_on()
            if not order.underway.over:
                continue
            del self._orders[actuator]
            if order.asked_for:
                self._answered = True
            elif order.pending.receipt is not None:
                self._outbox.receipts.append(order.pending.receipt)
            else:
                self._outbox.notice("fault", f"a pulse could not be ended: {order.pending.trouble}")

    def _drop_order(self, actuator: str, why: str) -> None:
        """Stop waiting for an answer; the outcome of the command is unknown."""
        order = self._orders.pop(actuator, None)
        if order is not None:
            order.underway.drop()
            order.pending.trouble = OutOfReach(why)
            self._answered = True

    def _drop_orders(self, why: str) -> None:
        for actuator in list(self._orders):
            self._drop_order(actuator, why)

    # --- the closed loop on the board ---------------------------------------------------------------------

    def cannot_regulate(self, loop: LoopSettings) -> str:
        """Return why this board cannot run a loop; empty if it can."""
        return cannot_regulate(self.identity, self._translation, loop)

    def regulate(self, loop: LoopSettings) -> PendingCommand:
        """Start a loop on the board."""
        value = self._outbox.commanded.get(loop.actuator, loop.low)
        board = self._free(loop.actuator)
        return self._regulated(loop.actuator, value, self._regulation.begin(board, loop, value))

    def loop_state(self, ahead: float | None = None) -> LoopState:
        """Return the state of the newest loop."""
        return self._regulation.state(ahead)

    def stop_regulating(self, actuator: str) -> PendingCommand:
        """End a loop, leaving its output unchanged."""
        board = self._free(actuator)
        value = self._outbox.commanded.get(actuator, 0.0)
        return self._regulated(actuator, value, self._regulation.end(board, actuator))

    def _free(self, actuator: str) -> Board:
        """Return the board once no other command of an actuator is pending."""
        self._check_open()
        board = self._check_reach()
        self._drop_order(actuator, "another command came before the board had answered")
        self._receiver.take(board)
        return board

    def _regulated(self, actuator: str, value: float, asked: Conversation[CommandReceipt]) -> PendingCommand:
        pending = self._pending(actuator, value)

        def conversation() -> Conversation[None]:
            try:
                receipt = yield from asked
            except Refused as error:
                hint = yield from _querying_trip(self._check_reach())
                pending.trouble = RigctlError(str(error), hint=hint, exit_code=ExitCode.FAILED)
                return
            self._outbox.commanded[actuator] = receipt.value
            pending.receipt = receipt

        return self._order(pending, conversation(), asked_for=True)

    # --- time passes --------------------------------------------------------------------------------------

    def _advance(self, board: Board, until: float) -> None:
        heartbeat = self._heartbeat
        if heartbeat is None:
            raise RuntimeError("a connected board without a heartbeat")
        silence = max(0.1, 3.0 / (self._rate or self._rig.monitor_rate))
        # The order: keep the board alive; read; see what its time says, as a restart makes everything after
        # it void; then continue what waits for answers; the stream last, so that reports of switches were
        # taken by the commands that wait for them.
        heartbeat.beat(silent=self.clock.now() - self._receiver.heard > silence)
        board.line.take(min(until, heartbeat.due, *self._ends.values(), *self._due()))
        heartbeat.listen()
        self._go_on()
        self._regulation.tend(board)
        self._receiver.take(board)

    def _due(self) -> list[float]:
        """Return when to continue the query in progress, s."""
        due = [order.underway.until for order in self._orders.values()]
        due += self._regulation.due
        return due if self._streaming is None else [*due, self._streaming.until]

    # --- loss of contact and reconnection -----------------------------------------------------------------

    def _unanswered(self) -> list[PendingCommand]:
        return [order.pending for order in self._orders.values()]

    def _handle_loss(self, board: Board, error: PortLost) -> tuple[str, Port | None]:
        self._streaming = None
        self._receiver.take(board)
        # The board ends its loop when it loses its host: the output has gone off without a command.
        if self._regulation.actuator:
            self._cut_off.add(self._regulation.actuator)
        self._regulation.forget()
        damaged = self._receiver.damage_since_heard(board)
        if not isinstance(error, NoAnswer):
            board.port.close()
            return damaged, None
        with suppress(PortLost):
            board.line.put("OUTP:SAFE")  # the board may still receive, even if its answers are lost
        return damaged, board.port  # reopening the port would restart an Uno, or let another host take it

    def _skip_missing(self, lost_at: float) -> int:
        return self._receiver.missing_since(lost_at, self._rate or self._rig.monitor_rate)


def _querying_trip(board: Board) -> Conversation[str | None]:
    """Find the trip that caused a refusal, if any."""
    try:
        causes = trip_causes((yield from board.asking_trips()))
    except NoAnswer:
        return None
    return f"The board has tripped: {', '.join(causes)}" if causes else None
