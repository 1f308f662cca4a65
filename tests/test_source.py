"""Rules of the source that no linter knows."""

from __future__ import annotations

import ast
from pathlib import Path

SOURCE = Path(__file__).parents[1] / "src" / "rigctl"


def bare_nexts(text: str) -> list[int]:
    """Lines with a `next` without a default on what may be empty: a search, or the first of a collection.

    Inside other iterators its StopIteration ends them silently; elsewhere it is a traceback without words.
    """
    found = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "next":
            (first, *default) = node.args
            fresh = isinstance(first, ast.GeneratorExp | ast.Call)
            if fresh and not default:
                found.append(node.lineno)
    return found


def test_a_search_that_may_find_nothing_is_told_from_one_that_cannot() -> None:
    assert bare_nexts("next(x for x in y)\nnext(iter(y))\nnext((x for x in y), 0)\nnext(counter)") == [1, 2]


def test_no_search_ends_in_stop_iteration() -> None:
    found = {str(path): bare_nexts(path.read_text("utf-8")) for path in SOURCE.rglob("*.py")}
    assert {name: lines for name, lines in found.items() if lines} == {}
