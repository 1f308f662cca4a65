"""Identifies the device on a port and measures the quality of the line, without switching anything."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from statistics import median

from rigctl.backends.lines.line_client import LineClient, WrongAnswer
from rigctl.backends.transport.port import Port, PortLost
from rigctl.clock import Clock
from rigctl.rig import Exchange, Lines

#: identity queries, the usual one first
QUESTIONS = ("*IDN?", "VER")
_WAKE = 3.0  # s needed by a board that restarts when its port is opened
_TIMEOUT = 0.4  # s


@dataclass(frozen=True)
class Link:
    """The quality of a line.

    Parameters
    ----------
    asked: number of queries.
    answered: number of correct answers.
    damaged: number of other answers.
    median, slowest: round-trip times, s; 0 without an answer.
    """

    asked: int
    answered: int
    damaged: int
    median: float
    slowest: float


@dataclass(frozen=True)
class Found:
    """The device that answered.

    Parameters
    ----------
    question: the query.
    identity: the answer.
    name: a readable name.
    """

    question: str
    identity: str
    name: str
    link: Link


def probe(connect: Callable[[], Port], clock: Clock, *, rounds: int = 50, patience: float = _WAKE) -> Found:
    """Identify the device on a port.

    A board that is reset by the opening of its port has `patience` s to start.

    Raises
    ------
    PortLost
        there is no such port, or no answer.
    RigctlError
        there is no permission to open it.
    """
    port = connect()
    try:
        client = LineClient(port, clock, _protocol(QUESTIONS[0]))
        question, identity = _first_answer(client, clock, patience)
        link = _measure(LineClient(port, clock, _protocol(question)), clock, question, identity, rounds)
    finally:
        port.close()
    return Found(question, identity, _name(identity), link)


def _protocol(question: str) -> Lines:
    exchange = {"send": question, "reply": "{_}"}
    return Lines.model_validate({"queries": [exchange], "timeout": f"{_TIMEOUT} s", "tries": 1})


def _ask(client: LineClient, question: str) -> str | None:
    """Return the answer; None if there is none, or if the device only echoes the query."""
    exchange = Exchange.model_validate({"send": question, "reply": "{identity}"})
    try:
        found = client.ask(exchange, tries=1).found["identity"]
    except WrongAnswer:
        return None
    return found if found and found.casefold() != question.casefold() else None


def _first_answer(client: LineClient, clock: Clock, patience: float) -> tuple[str, str]:
    """Return the first of `QUESTIONS` that the device answers, and its answer."""
    give_up = clock.now() + patience
    client.port.write(b"\n")  # terminates any incomplete command
    client.idle(clock.now() + 0.2)
    while True:
        for question in QUESTIONS:
            try:
                identity = _ask(client, question)
            except PortLost:
                if clock.now() >= give_up:
                    raise PortLost(_silence(client)) from None
                continue
            if identity is not None:
                return question, identity
        if clock.now() >= give_up:
            raise PortLost(_silence(client))


def _silence(client: LineClient) -> str:
    if client.heard:
        return f"{client.port.name}: something is sent, but no answer to *IDN? or VER; another baud rate?"
    return f"{client.port.name}: nobody answers *IDN? or VER"


def _measure(client: LineClient, clock: Clock, question: str, identity: str, rounds: int) -> Link:
    trips: list[float] = []
    damaged = 0
    for _ in range(rounds):
        began = clock.now()
        try:
            answer = _ask(client, question)
        except PortLost:
            continue
        if answer == identity:
            trips.append(clock.now() - began)
        else:
            damaged += 1
    return Link(rounds, len(trips), damaged, median(trips) if trips else 0.0, max(trips, default=0.0))


def _name(identity: str) -> str:
    if identity.startswith("RIGCTL,"):
        _, kind, _, version = (*identity.split(","), "", "", "")[:4]
        return f"board with rigctl's firmware, {kind} {version}"
    if identity.startswith("TCLab"):
        return f"two-heater board, {identity}"
    return identity
