"""A device that a library speaks to, as one of lines: the lines are those of the library's client.

The client (`rigctl.backends.transport.client_port.Client`) understands ``identify``, ``read N``, ``write NAME
VALUE`` and ``beat``, and answers with numbers, ``ok``, or ``error`` and the reason. All that a bench of lines
does holds for it as well: one question at a time, reconnection, its guard.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from rigctl.errors import RigctlError, unknown_name
from rigctl.rig.actuator import Actuator
from rigctl.rig.channel import Channel
from rigctl.rig.lines import Lines
from rigctl.rig.problem import Problem
from rigctl.rig.setting import POSITIONS

_MARGIN = 0.2  # s that an answer may take on its way between the client and the bench


def client_lines(
    *,
    identity: str,
    reads: Sequence[tuple[Sequence[str], float | None]],
    writes: Mapping[str, Mapping[str, str] | None],
    timeout: float,
    tries: int,
    wake: float,
    fastest: float | None,
    beat: float | None,
    watchdog: float,
) -> Lines:
    """The lines of a client.

    Parameters
    ----------
    identity: what it answers to ``identify``, as a pattern.
    reads: the names that each ``read`` gives, and how often in s it is asked at the most; None: each sample.
    writes: actuator to what stands for its positions; None for one that takes a number.
    timeout: s that the device may take.
    fastest: Hz; None where nothing says it.
    beat: s between two ``beat``; None for a device that wants none.
    """
    queries = [
        {
            "send": f"read {index}",
            "reply": " ".join(f"{{{name}}}" for name in names),
            **({} if every is None else {"every": f"{every:g} s"}),
        }
        for index, (names, every) in enumerate(reads)
    ]
    actuators = {
        name: {"send": f"write {name} {{value:.9e}}", "reply": "ok"}
        if words is None
        else {"send": f"write {name} {{value}}", "reply": "ok", "words": dict(words)}
        for name, words in writes.items()
    }
    return Lines.model_validate(
        {
            "timeout": f"{timeout + _MARGIN:g} s",
            "tries": tries,
            "wake": f"{wake:g} s",
            "fastest": None if fastest is None else f"{fastest:g} Hz",
            "identify": {"send": "identify", "reply": identity},
            "queries": queries,
            "actuators": actuators,
            "errors": ["error {_}"],
            "keep_alive": None if beat is None else {"send": "beat", "reply": "ok", "every": f"{beat:g} s"},
            "watchdog": f"{watchdog:g} s",
        }
    )


def positions_of(
    actuators: Mapping[str, Actuator], name: str, values: Mapping[str, float] | None
) -> dict[str, str] | None:
    """What stands for an actuator's positions, as the client is told; None for one that takes a number."""
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
    """Each channel is read, each driven actuator written, each position has a number, no other name is used.

    Parameters
    ----------
    at: where the device's part is in the file.
    read: what is read, by channel.
    written: what is written, by actuator: the numbers of its positions.
    """
    for name in read:
        if name not in channels:
            yield Problem((*at, "channels", name), unknown_name("channel", name, channels), of_key=True)
    misspelt = any(name not in channels for name in read)  # hides the one that it left missing
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
        return
    if positions is None:
        error = RigctlError("a level has no positions", expected="a number in its unit")
        yield Problem((*keys, "values"), error, of_key=True)
        return
    for word in values:
        if word not in positions:
            yield Problem((*keys, "values", word), unknown_name("position", word, positions), of_key=True)
    missing = [word for word in positions if word not in values]
    if missing:
        error = RigctlError("values: a position has none", value=", ".join(missing), expected="one for each")
        yield Problem((*keys, "values"), error)
    elif len(set(values.values())) < len(values):
        yield Problem((*keys, "values"), RigctlError("values: two positions have the same"))
