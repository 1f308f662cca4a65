from __future__ import annotations

import pytest

from rigctl.wording import listed, number_of


@pytest.mark.parametrize(
    ("count", "words", "text"),
    [
        (1, ("record",), "1 record"),
        (0, ("record",), "0 records"),
        (2, ("quantity", "quantities"), "2 quantities"),
    ],
)
def test_a_noun_agrees_with_its_number(count: int, words: tuple[str, ...], text: str) -> None:
    assert number_of(count, *words) == text


@pytest.mark.parametrize(
    ("names", "text"), [((), ""), (("a",), "a"), (("a", "b"), "a or b"), (("a", "b", "c"), "a, b or c")]
)
def test_a_list_ends_with_its_conjunction(names: tuple[str, ...], text: str) -> None:
    assert listed(names, "or") == text
