"""Effects that are alternatives for the same physics: a model has at most one of them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

from rigctl.effects.declaration import Effect
from rigctl.errors import RigctlError


def refuse_contradictions(effects: Sequence[Effect]) -> None:
    """Require that no two of `effects` contradict one another.

    Raises
    ------
    RigctlError
        two do; the message names them.
    """
    for one, other in combinations(effects, 2):
        if other.name in one.instead_of or one.name in other.instead_of:
            raise RigctlError(
                f"{one.name} and {other.name} contradict one another: they describe the same in two ways",
                hint="Remove one of them",
            )
