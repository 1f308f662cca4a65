"""The bench on rigctl's own board, as the runner sees it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass

from rigctl.backends.commands import check_command, driven_outputs
from rigctl.backends.conversation import Conversation, Underway, carry_through
from rigctl.backends.errors import BackendLost, BenchTripped, OutOfReach
from rigctl.backends.protocol import CommandReceipt, Notice, PendingCommand, Sample
from rigctl.backends.serial.board import Board, trip_causes
from rigctl.backends.serial.greeting import greeting
from rigctl.backends.serial.heartbeat import Heartbeat
from rigctl.backends.serial.intake import Intake
from rigctl.backends.serial.line import Line, Refused
from rigctl.backends.serial.port import Connect, NoAnswer, Port, PortLost
from rigctl.backends.serial.reaching import reach
from rigctl.backends.serial.reconnection import Meeting, Reconnection
from rigctl.backends.serial.switching import Switching
from rigctl.backends.serial.translation import Translation
from rigctl.backends.serial.wiring import Wiring
from rigctl.clock import Clock
from rigctl.errors import ExitCode, RigctlError
from rigctl.rig import Rig

HOST_SILENT = "host silent"  #: the trip that a host's coming ends
_SAFE_ANSWER, _SAFE_TRIES = 0.1, 8  # s, to make safe within a second also where lines are lost


@dataclass(frozen=True, slots=True)
class _Order:
    """A command to which the board has not answered yet; `asked_for` where the caller waits for it."""

    pending: PendingCommand
    underway: Underway[None]
    asked_for: bool


class SerialBench:
    """A `Backend` for rigctl's own board, on any `Port`.

    Parameters
    ----------
    rig: what channels and actuators there are.
    clock: what waits are counted on.
    connect: opens the port; called again when it was lost.
    wiring: what is connected where.
    kind: ``serial`` or ``emulated``, for the identity.
    baud: bits per second.
    patience: s for a board that starts anew when its port is opened.
    reconnect: s for a lost board to come back.
    clear_trips: whether trips that are latched from before are cleared when the bench is opened; see
        docs/decisions/0011-who-clears-a-trip.md.
    by_hand: told when the operator turns something, where the operator is emulated too.
    """

    timed = True
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
        reconnect: float = 30.0,
        clear_trips: bool = False,
        identity: Mapping[str, str] | None = None,
        by_hand: Callable[[str, float], None] | None = None,
    ) -> None:
        self.clock = clock
        self.identity: Mapping[str, str] = {"kind": kind, "name": rig.name, **(identity or {})}
        self._rig = rig
        self._connect = connect
        self._translation = Translation(rig, wiring)
        self._baud = baud
        self._patience = patience
        self._reconnection = Reconnection(
            clock, connect, lambda port: self._meet(port, again=True), reconnect
        )
        self._clear_trips = clear_trips
        self._by_hand = by_hand
        self._board: Board | None = None
        self._opened = False
        self._rate = 0.0
        self._heartbeat: Heartbeat | None = None
        self._trip_told = False
        self._cut_off: set[str] = set()  # what was driven, or may have been, when contact was lost
        self._ends: dict[str, float] = {}  # pulses that are timed here
        self._intake = Intake(self._translation, clock)
        self._switching = Switching(self._translation, self._intake, clock)
        self._orders: dict[str, _Order] = {}
        self._answered = False  # since `next_sample` was called
        self._streaming: Underway[None] | None = None

    @property
    def outputs_read(self) -> frozenset[str]:
        """What the board reports with each sample."""
        return self._translation.reported

    @property
    def outputs_answered(self) -> frozenset[str]:
        """The board answers every command."""
        return driven_outputs(self._rig)

    # --- open and close -----------------------------------------------------------------------------------

    def open(self) -> None:
        """Reach the board, check what it is, make its outputs safe, and learn its clock."""
        with reach(self._connect) as port:
            self._board = self._meet(port, again=False).carry_through()
        self._opened = True

    def close(self) -> None:
        """Make outputs safe where the board can still be reached, and let the port go."""
        board, self._board = self._board, None
        self._opened = False
        self._reconnection.drop()
        self._drop_orders("the bench was let go")
        if board is None:
            return
        try:
            self._make_safe(board)
            board.line.ask("STRM 0")
        except (PortLost, Refused):
            pass  # its own watchdog switches it off
        board.line.port.close()

    # --- samples ------------------------------------------------------------------------------------------

    def start(self, rate: float) -> None:
        """Let the board sample at `rate` Hz from now on."""
        if not (math.isfinite(rate) and rate > 0.0):
            raise RigctlError("not a sampling rate", value=f"{rate:g} Hz", expected="e.g. '100 Hz'")
        if not 0.01 <= rate <= 2000.0:
            raise RigctlError(
                "the board cannot sample like this", value=f"{rate:g} Hz", expected="0.01 to 2000 Hz"
            )
        self._check_open()
        self._rate = rate
        if self._board is None:  # one that comes back begins its stream by itself
            return
        try:
            self._streaming = Underway(self._stream(self._board))
        except PortLost as error:
            self._lose(error)

    def next_sample(self, timeout: float) -> Sample | None:
        """The next line of the stream as a sample, on the bench's clock."""
        self._check_open()
        deadline = self.clock.now() + timeout
        self._answered = False
        while not self._intake.samples:
            if self._intake.tripped:
                if not self._trip_told:  # the notice and the receipts of the trip are fetched first
                    self._trip_told = True
                    return None
                raise BackendLost(f"the board has tripped: {self._intake.tripped}")
            if self._answered or self.clock.now() >= deadline:
                return None
            self._pump(deadline)
        return self._intake.samples.popleft()

    def take_receipts(self) -> list[CommandReceipt]:
        """Switches that the board made by itself: ends of pulses, trips."""
        taken, self._intake.receipts = self._intake.receipts, []
        return taken

    def take_notices(self) -> list[Notice]:
        """Gaps, damaged lines, trips, losses and returns of the line."""
        taken, self._intake.notices = self._intake.notices, []
        return taken

    # --- commands -----------------------------------------------------------------------------------------

    def command(self, actuator: str, value: float, *, duration: float | None = None) -> PendingCommand:
        """Send a command; its receipt will have the time that the board stamped."""
        self._check_open()
        check_command(self._rig, actuator, value, duration)
        if self._rig.actuators[actuator].by == "operator":
            if self._by_hand is not None:
                self._by_hand(actuator, value)
            self._intake.commanded[actuator] = value
            return PendingCommand.answered(CommandReceipt(self.clock.now(), actuator, value))
        return self._order(actuator, value, duration, asked_for=True)

    def safe(self) -> None:
        """Switch everything off now."""
        self._check_open()
        self._ends.clear()
        self._drop_orders("outputs were made safe before the board had answered")
        if self._board is None:
            raise BackendLost(f"the bench cannot be reached: {self._reconnection.why}")
        try:
            self._make_safe(self._board)
            self._intake.take(self._board)
        except Refused as error:
            raise BackendLost(str(error)) from None
        except PortLost as error:
            self._lose(error)
            raise BackendLost(f"the bench cannot be reached: {error}") from None

    # --- inside -------------------------------------------------------------------------------------------

    def _check_open(self) -> None:
        if not self._opened:
            raise BackendLost("the bench is not open")

    def _meet(self, port: Port, *, again: bool) -> Meeting[Board]:
        """Begin to ask who is there, on a port that has just been opened, or `again` after a loss."""
        line = Line(port, self.clock, self._baud)
        return Meeting(port, line.poll, self._greet(line, again=again))

    def _greet(self, line: Line, *, again: bool) -> Conversation[Board]:
        try:
            return (yield from self._begin(line, again=again))
        except Refused as error:
            raise PortLost(str(error)) from None

    def _begin(self, line: Line, *, again: bool) -> Conversation[Board]:
        """Ask who is there, and take that board: safe, trips known, clock learnt, stream begun."""
        board = yield from greeting(line, self._patience)
        known = self.identity.get("firmware")
        if known is not None and known != board.identity["firmware"]:
            raise RigctlError(
                "another board answers than before", value=board.identity["firmware"], expected=known
            )
        yield from self._making_safe(board)
        yield from board.asking("STRM 0")
        yield from board.learning_clock(8)
        board.line.forget()
        self.identity = {**self.identity, **board.identity}
        self._intake.tripped, self._trip_told = "", False
        known_commands = dict.fromkeys(self._rig.actuators, 0.0) | self._intake.commanded
        self._intake.commanded = known_commands | self._resting()
        try:
            yield from self._settling_trips(board)
        except BenchTripped as tripped:
            if not again:
                raise
            self._intake.tripped = tripped.causes  # it can be reached, but does nothing any more
            self._reconnection.why = tripped.what
            self._intake.notice("alarm", tripped.what)
        else:
            yield from self._stream(board)
        self._heartbeat = Heartbeat(board, self.clock)
        return board

    def _resting(self) -> dict[str, float]:
        return {name: float(value) for name, value in self._rig.safe_state.items()}

    def _making_safe(self, board: Board) -> Conversation[None]:
        yield from board.line.asking("OUTP:SAFE", _SAFE_ANSWER, _SAFE_TRIES)
        for text in self._translation.safe_texts():
            yield from board.asking(text)

    def _make_safe(self, board: Board) -> None:
        """Make it safe, and wait for the answer."""
        carry_through(self._making_safe(board), board.line.poll)

    def _settling_trips(self, board: Board) -> Conversation[None]:
        """A silence of the host is over once a host is there; every other trip waits for a person."""
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
        self._intake.notice("note", f"the board had tripped before: {causes}; cleared")

    def _stream(self, board: Board) -> Conversation[None]:
        """Let the board begin its stream at the present rate."""
        self._intake.restarting = True
        try:
            answer = yield from board.line.asking(f"STRM {self._rate or self._rig.monitor_rate:.3f}")
        except Refused as error:
            raise NoAnswer(str(error)) from None
        self._intake.restart(board, answer.readings_before)
        self._intake.wanted = self._rate > 0.0

    def _order(
        self, actuator: str, value: float, duration: float | None, *, asked_for: bool
    ) -> PendingCommand:
        """Send a command; the answer is waited for in `_pump`."""
        board = self._board
        if board is None:
            raise OutOfReach(f"the board cannot be reached for the moment: {self._reconnection.why}")
        self._ends.pop(actuator, None)
        self._drop_order(actuator, "another command came before the board had answered")
        self._intake.take(board)  # what happened before is none of its doing
        pending = PendingCommand(actuator, value, lambda: self._pump(math.inf))
        try:
            underway = Underway(self._carry_out(board, pending, duration))
        except PortLost as error:
            self._doubt(pending)
            self._lose(error)
            raise OutOfReach(f"contact with the board is lost: {error}") from None
        self._orders[actuator] = _Order(pending, underway, asked_for)
        return pending

    def _carry_out(self, board: Board, pending: PendingCommand, duration: float | None) -> Conversation[None]:
        """Switch, and note what the board says of it."""
        actuator, value = pending.actuator, pending.value
        try:
            receipt = yield from self._switching.switch(board, actuator, value, duration)
        except Refused as error:
            hint = yield from _asking_why(board)
            pending.trouble = RigctlError(str(error), hint=hint, exit_code=ExitCode.FAILED)
            return
        self._intake.commanded[actuator] = value
        if duration is not None and not self._translation.times_pulse(actuator, duration):
            self._ends[actuator] = receipt.time + duration
        pending.receipt = receipt

    def _go_on(self) -> None:
        """Go on with what the board has been asked; raises `PortLost`."""
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
                self._intake.receipts.append(order.pending.receipt)
            else:
                self._intake.notice("fault", f"a pulse could not be ended: {order.pending.trouble}")

    def _drop_order(self, actuator: str, why: str) -> None:
        """Do not wait for an answer any more; what became of the command is not known."""
        order = self._orders.pop(actuator, None)
        if order is not None:
            order.underway.drop()
            order.pending.trouble = OutOfReach(why)
            self._answered = True

    def _drop_orders(self, why: str) -> None:
        for actuator in list(self._orders):
            self._drop_order(actuator, why)

    def _doubt(self, pending: PendingCommand) -> None:
        """A command may have been carried out when contact was lost."""
        if pending.value != self._resting().get(pending.actuator):
            self._cut_off.add(pending.actuator)

    def _pump(self, until: float) -> None:
        """Let time pass up to `until`, or until something arrived."""
        now = self.clock.now()
        for actuator in [name for name, end in self._ends.items() if end <= now]:
            del self._ends[actuator]
            with suppress(OutOfReach):  # a board that comes back is made safe before anything else
                self._order(actuator, float(self._rig.safe_state[actuator]), None, asked_for=False)
        board, heartbeat = self._board, self._heartbeat
        if board is None or heartbeat is None:
            self._try_again(until)
            return
        silence = max(0.1, 3.0 / (self._rate or self._rig.monitor_rate))
        try:
            heartbeat.beat(silent=now - self._intake.heard > silence)
            board.line.poll(min(until, heartbeat.due, *self._ends.values(), *self._due()))
            heartbeat.listen()
            self._go_on()
        except PortLost as error:
            self._lose(error)
            return
        self._intake.take(board)

    def _due(self) -> list[float]:
        """When to go on with what the board has been asked, s."""
        due = [order.underway.until for order in self._orders.values()]
        return due if self._streaming is None else [*due, self._streaming.until]

    def _lose(self, error: PortLost) -> None:
        """Contact is lost; what the board does by itself now is to switch off."""
        board, self._board = self._board, None
        self._streaming = None
        for order in self._orders.values():
            self._doubt(order.pending)
        self._drop_orders(f"contact with the board is lost: {error}")
        damaged, kept = "", None
        if board is not None:
            self._intake.take(board)
            damaged = self._intake.damage_since_heard(board)
            if isinstance(error, NoAnswer):  # opening it again would restart an Uno, or let another host in
                kept = board.line.port
                with suppress(PortLost):
                    board.line.put("OUTP:SAFE")  # whether or not its answers get through
            else:
                board.line.port.close()
        self._cut_off |= self._driven()
        self._reconnection.begin(f"{error}{damaged}", kept)
        self._intake.notice("fault", f"contact with the board is lost: {error}{damaged}")

    def _try_again(self, until: float) -> None:
        """What can be done by bench time `until` to find the board again."""
        board = self._reconnection.attempt(until)
        if board is None:
            return
        self._board = board
        lost_at, why = self._reconnection.since, self._reconnection.why
        now = self.clock.now()
        self._intake.notice("note", f"the board is back after {now - lost_at:.1f} s, outputs off")
        switched_off = sorted(self._cut_off)
        self._cut_off.clear()
        resting, half = self._resting(), 0.5 * (now - lost_at)  # when, is not known any better
        self._intake.receipts += [
            CommandReceipt(now - half, name, resting[name], half) for name in switched_off
        ]
        missing = self._intake.missing_since(lost_at, self._rate or self._rig.monitor_rate)
        self._intake.gap(missing, cause=why, switched_off=switched_off)

    def _driven(self) -> set[str]:
        """Actuators that are commanded to something else than their safe value."""
        resting = self._resting()
        return {name for name, value in self._intake.commanded.items() if resting.get(name, value) != value}


def _asking_why(board: Board) -> Conversation[str | None]:
    """What a refusal comes from, where a trip is behind it."""
    try:
        causes = trip_causes((yield from board.asking_trips()))
    except NoAnswer:
        return None
    return f"The board has tripped: {', '.join(causes)}" if causes else None
