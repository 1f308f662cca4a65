"""The positions of an actuator and their representations in a protocol."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from rigctl.errors import RigctlError, unknown_name
from rigctl.rig.problem import Problem


def position_problems(
    field: str, positions: Iterable[str], given: Mapping[str, object], keys: tuple[str | int, ...]
) -> Iterator[Problem]:
    """Check that each position has a representation, no other name has one, and no two are equal.

    Parameters
    ----------
    field: description of the field that contains the representations.
    given: the representation of each position.
    keys: their location in the file.
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
