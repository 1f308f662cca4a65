"""A device behind a protocol library, described as a line-based device with the client's commands.

The client (`rigctl.backends.transport.client_port.Client`) understands ``identify``, ``read N``, ``write NAME
VALUE``, ``safe N`` and ``beat``, and answers with numbers, ``ok``, or ``error`` and the reason. It is
operated like any line-based device: one query at a time, reconnection, a guard.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Protocol

from pydantic import Field

from rigctl.errors import RigctlError, unknown_name
from rigctl.files.quantity import Q
from rigctl.rig.actuator import Actuator
from rigctl.rig.channel import Channel
from rigctl.rig.problem import Problem
from rigctl.rig.protocols.lines import Lines
from rigctl.rig.protocols.positions import position_problems
from rigctl.rig.setting import POSITIONS

_MARGIN = 0.2  # allowance for the transfer of an answer from the client to the bench, s


class Positioned(Protocol):
    """The register or node that sets an actuator."""

    @property
    def values(self) -> Mapping[str, float] | None:
        """The numbers of its positions; None if they have the default numbers, or it takes a level."""


class Beating(Protocol):
    """The register or node of the heartbeat counter."""

    @property
    def every(self) -> float:
        """The time between two counts, s."""


class ClientDevice(Protocol):
    """A device behind a protocol library, as described in a rig file; times in s, rates in Hz."""

    @property
    def timeout(self) -> float:
        """The time-out of an answer."""

    @property
    def tries(self) -> int:
        """The number of attempts before a query counts as lost."""

    @property
    def wake(self) -> float:
        """The time allowed for the first answer after connecting."""

    @property
    def fastest(self) -> float | None:
        """The highest polling rate; None if not stated."""

    @property
    def actuators(self) -> Mapping[str, Positioned]:
        """The registers or nodes of the actuators, by name."""

    @property
    def heartbeat(self) -> Beating | None:
        """The heartbeat counter; None if the device has none."""

    @property
    def watchdog(self) -> float:
        """The time without contact with rigctl after which the guard makes outputs safe."""


#: types of fields that are common to such devices
Positions = Annotated[
    dict[str, int] | None,
    Field(
        description="for a switch or a directional valve: the numbers of its positions; by default 0 and 1",
    ),
]
Tries = Annotated[int, Field(ge=1, le=5, description="number of attempts before a query counts as lost")]
Every = Annotated[
    Annotated[float, Q("s", positive=True)] | None,
    Field(
        description="shortest interval between readings, with the last value used in between; by "
        "default for each sample"
    ),
]


def client_lines(
    device: ClientDevice,
    actuators: Mapping[str, Actuator],
    *,
    identity: str,
    reads: Sequence[tuple[Sequence[str], float | None]],
    timeout: float | None = None,
    safe: int = 0,
) -> Lines:
    """Return the line protocol of a client.

    Parameters
    ----------
    actuators: the actuators of the rig.
    identity: pattern of the client's answer to ``identify``.
    reads: the names that each ``read`` returns, and its shortest interval, s; None: every sample.
    timeout: of an answer, s; by default the device's, with an allowance.
    safe: how many commands ``safe N`` make outputs safe, before the safe values are written.
    """
    # From here on the device looks like one with lines: nothing below knows of registers or nodes.
    writes = {name: _positions_of(actuators, name, part.values) for name, part in device.actuators.items()}
    beat = device.heartbeat
    queries = [
        {
            "send": f"read {index}",
            "reply": " ".join(f"{{{name}}}" for name in names),
            **({} if every is None else {"every": f"{every:g} s"}),
        }
        for index, (names, every) in enumerate(reads)
    ]
    settings = {
        name: {"send": f"write {name} {{value:.9e}}", "reply": "ok"}
        if words is None
        else {"send": f"write {name} {{value}}", "reply": "ok", "words": dict(words)}
        for name, words in writes.items()
    }
    return Lines.model_validate(
        {
            "timeout": f"{device.timeout + _MARGIN if timeout is None else timeout:g} s",
            "tries": device.tries,
            "wake": f"{device.wake:g} s",
            "fastest": None if device.fastest is None else f"{device.fastest:g} Hz",
            "identify": {"send": "identify", "reply": identity},
            "queries": queries,
            "actuators": settings,
            "errors": ["error {_}"],
            "keep_alive": None
            if beat is None
            else {"send": "beat", "reply": "ok", "every": f"{beat.every:g} s"},
            "safe": [{"send": f"safe {index}", "reply": "ok"} for index in range(safe)],
            "watchdog": f"{device.watchdog:g} s",
        }
    )


def _positions_of(
    actuators: Mapping[str, Actuator], name: str, values: Mapping[str, float] | None
) -> dict[str, str] | None:
    """Return the numbers of an actuator's positions, as texts for the client; None if it takes a level."""
    positions = POSITIONS.get(actuators[name].kind) if name in actuators else None
    if positions is None:
        return None
    return {word: f"{number:g}" for word, number in (values or positions).items()}


def client_problems(
    channels: Mapping[str, Channel],
    actuators: Mapping[str, Actuator],
    at: tuple[str, ...],
    read: Mapping[str, object],
    written: Mapping[str, Mapping[str, float] | None],
) -> Iterator[Problem]:
    """Check that all channels are read, driven actuators written, positions numbered and names known.

    Parameters
    ----------
    at: location of the device's section in the file.
    read: the registers or nodes that are read, by channel.
    written: for each actuator that is written, the numbers of its positions.
    """
    for name in read:
        if name not in channels:
            yield Problem((*at, "channels", name), unknown_name("channel", name, channels), of_key=True)
    misspelt = any(name not in channels for name in read)  # it explains a channel that is not read
    for name in channels:
        if name not in read and not misspelt:
            error = RigctlError(f"channels: nothing says where '{name}' is read", expected="every channel")
            yield Problem((*at, "channels"), error)
    driven = [name for name, actuator in actuators.items() if actuator.by == "driven"]
    misspelt = any(name not in driven for name in written)
    for name in driven:
        if name not in written and not misspelt:
            error = RigctlError(
                f"actuators: nothing says where '{name}' is written", expected="every driven actuator"
            )
            yield Problem((*at, "actuators") if written else at, error)
    for name, values in written.items():
        keys = (*at, "actuators", name)
        if name not in driven:
            yield Problem(keys, unknown_name("driven actuator", name, driven), of_key=True)
        else:
            yield from _positions(actuators[name], values, keys)


def _positions(
    actuator: Actuator, values: Mapping[str, float] | None, keys: tuple[str, ...]
) -> Iterator[Problem]:
    positions = POSITIONS.get(actuator.kind)
    if values is None:
        if actuator.kind == "directional_valve":
            error = RigctlError(
                "values: a valve's positions need numbers", expected="{retract: 2, neutral: 0, …}"
            )
            yield Problem(keys, error)
        return
    if positions is None:
        error = RigctlError("a level has no positions", expected="a number in its unit")
        yield Problem((*keys, "values"), error, of_key=True)
        return
    yield from position_problems("values", positions, values, (*keys, "values"))
