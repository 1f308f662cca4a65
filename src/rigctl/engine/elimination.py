"""The linear systems of a step as straight-line code: LU in order, of the entries that a Jacobian has.

Which entries of ``I - h·gamma·∂f/∂y`` are zero whatever the state, the equations tell: the elimination is
written out for the others alone, the few that it fills in among them. Numbers then stay in registers, and no
loop runs over zeros; what is computed is what `kernels.linear` would, operation by operation, which has the
same with exchanges of rows for where this one is not safe.

``factorise``  LU factors of the matrix, U's diagonal inverted, and whether a multiplier is too large for it
``solve``      a right-hand side replaced by the solution

A multiplier is large where each row is taken relative to its largest entry and each column in the unit of
its unknown: scaled partial pivoting, content with a pivot that is not the best (N. J. Higham, Accuracy and
Stability of Numerical Algorithms, 9).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

#: of the two functions, their arrays in the order they take them
ARGUMENTS: Mapping[str, tuple[str, ...]] = {
    "factorise": ("jacobian", "unit", "reach", "matrix", "refused"),
    "solve": ("matrix", "value"),
}

_LARGEST_MULTIPLIER = 100.0

#: (row, column) of entries that are not zero whatever the state
Places = frozenset[tuple[int, int]]


def elimination(n: int, jacobian: Iterable[tuple[int, int]]) -> str:
    """Both functions for n states, of a ∂f/∂y with the entries `jacobian` (row, column).

    ``factorise`` takes ``h·gamma`` as `reach` and the tolerance of each state as `unit`, and leaves the other
    entries of `matrix` (n, n) as they are: zero; `refused` is above zero where it is not safe.
    """
    given = frozenset(jacobian)
    filled = _filled(n, given)
    return _factorise(n, given, filled) + _solve(n, filled)


def _filled(n: int, given: Places) -> Places:
    """The entries of L and U, the diagonal among them."""
    found = {*given, *((k, k) for k in range(n))}
    for k in range(n):
        columns = [j for j in range(k + 1, n) if (k, j) in found]
        for i in range(k + 1, n):
            if (i, k) in found:
                found.update((i, j) for j in columns)
    return frozenset(found)


class _Lines:
    """Straight-line code as `straight_line` reads it: one operation a line, each with its number."""

    def __init__(self, name: str) -> None:
        self.lines = [f"function {name} {' '.join(ARGUMENTS[name])}"]
        self.count = 0

    def __call__(self, *operation: object) -> int:
        """One operation more; its number."""
        self.lines.append(" ".join(map(str, (self.count, *operation))))
        self.count += 1
        return self.count - 1

    def store(self, array: str, index: int, number: int) -> None:
        """Write a number to an array."""
        self.lines.append(f"store {array} {index} {number}")

    def text(self) -> str:
        """All of it."""
        return "\n".join([*self.lines, "end\n"])


def _factorise(n: int, given: Places, filled: Places) -> str:
    write = _Lines("factorise")
    one, most = write("constant", 1.0), write("constant", _LARGEST_MULTIPLIER)
    refused = none = write("constant", 0.0)
    reach = write("negative", write("load", "reach", 0))
    matrix = {(i, j): write("*", reach, write("load", "jacobian", i * n + j)) for i, j in sorted(given)}
    for k in range(n):
        matrix[k, k] = write("+", matrix[k, k], one) if (k, k) in matrix else one
    unit, size = [write("load", "unit", j) for j in range(n)], []
    for i in range(n):
        largest = none
        for j in range(n):
            if (i, j) in matrix:
                largest = write("larger", write("*", write("fabs", matrix[i, j]), unit[j]), largest)
        size.append(largest)
    for k in range(n):
        matrix[k, k] = write("/", one, matrix[k, k])
        for i in range(k + 1, n):
            if (i, k) not in filled:
                continue
            factor = matrix[i, k] = write("*", matrix[i, k], matrix[k, k])
            scaled = write("*", write("fabs", factor), size[k])
            refused = write("+", refused, write("beyond", scaled, write("*", most, size[i])))
            for j in range(k + 1, n):
                if (k, j) in filled:
                    less = write("*", factor, matrix[k, j])
                    known = matrix.get((i, j))
                    matrix[i, j] = write("negative", less) if known is None else write("-", known, less)
    for i, j in sorted(filled):
        write.store("matrix", i * n + j, matrix[i, j])
    write.store("refused", 0, refused)
    return write.text()


def _solve(n: int, filled: Places) -> str:
    write = _Lines("solve")
    value = [write("load", "value", i) for i in range(n)]

    def entry(i: int, j: int) -> int:
        return write("load", "matrix", i * n + j)

    for i in range(n):
        for k in range(i):
            if (i, k) in filled:
                value[i] = write("-", value[i], write("*", entry(i, k), value[k]))
    for i in range(n - 1, -1, -1):
        for k in range(n - 1, i, -1):
            if (i, k) in filled:
                value[i] = write("-", value[i], write("*", entry(i, k), value[k]))
        value[i] = write("*", value[i], entry(i, i))
    for i in range(n):
        write.store("value", i, value[i])
    return write.text()
