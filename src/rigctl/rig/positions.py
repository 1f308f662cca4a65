"""The positions of an actuator, each with what stands for it on the line."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from rigctl.errors import RigctlError, unknown_name
from rigctl.rig.problem import Problem


def position_problems(
    field: str, positions: Iterable[str], given: Mapping[str, object], keys: tuple[str | int, ...]
) -> Iterator[Problem]:
    """Each position stands there once, no other does, and no two look alike on the line.

    Parameters
    ----------
    field: what holds them, in words.
    given: what stands for each.
    keys: where they are in the file.
    """
    known = tuple(positions)
    for word in given:
        if word not in known:
            yield Problem((*keys, word), unknown_name("position", word, known), of_key=True)
    missing = [word for word in known if word not in given]
    if missing:
        error = RigctlError(
            f"{field}: a position has none", value=", ".join(missing), expected="one for each"
        )
        yield Problem(keys if given else keys[:-1], error)
    elif len(set(given.values())) < len(given):
        yield Problem(keys, RigctlError(f"{field}: two positions have the same"))
