"""The linear systems of a step as straight-line code: LU decomposition of the entries that can be nonzero.

The equations determine which entries of ``I - h·gamma·∂f/∂y`` are zero in every state. The elimination is
written out for the others only, including those that it fills in. Numbers then stay in registers, and no loop
runs over zeros. The operations are those of `kernels.linear`, one by one; that module also has the version
with row exchanges for matrices for which this one is not safe.

``factorise``  LU factors of the matrix, U's diagonal inverted, and whether a multiplier is too large for it
``solve``      a right-hand side replaced by the solution

Whether a multiplier is too large is judged with each row divided by its largest entry and each column in the
unit of its unknown: scaled partial pivoting that accepts a pivot other than the largest (N. J. Higham,
Accuracy and Stability of Numerical Algorithms, 9).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

#: the arrays of the two functions, in the order of their arguments
ARGUMENTS: Mapping[str, tuple[str, ...]] = {
    "factorise": ("jacobian", "unit", "reach", "matrix", "refused"),
    "solve": ("matrix", "value"),
}

_LARGEST_MULTIPLIER = 100.0

#: (row, column) of entries that can be nonzero
Places = frozenset[tuple[int, int]]


def elimination(n: int, jacobian: Iterable[tuple[int, int]]) -> str:
    """Source of both functions, for n states and a ∂f/∂y with the nonzero entries `jacobian` (row, column).

    ``factorise`` has ``h·gamma`` as `reach` and the tolerance of each state as `unit`, and leaves the other
    entries of `matrix` (n, n) unchanged, at zero; `refused` is positive if the elimination is not safe.
    """
    given = frozenset(jacobian)
    filled = _filled(n, given)
    return _factorise(n, given, filled) + _solve(n, filled)


def _filled(n: int, given: Places) -> Places:
    """The entries of L and U, the diagonal among them."""
    # eliminating column k fills in where its row and a lower row have entries: once for the pattern, not for
    # the numbers
    entries = {*given, *((k, k) for k in range(n))}
    for k in range(n):
        columns = [j for j in range(k + 1, n) if (k, j) in entries]
        for i in range(k + 1, n):
            if (i, k) in entries:
                entries.update((i, j) for j in columns)
    return frozenset(entries)


class _Lines:
    """Straight-line code in the form of `straight_line`: one numbered operation in each line."""

    def __init__(self, name: str) -> None:
        self.lines = [f"function {name} {' '.join(ARGUMENTS[name])}"]
        self.count = 0

    def __call__(self, *operation: object) -> int:
        """Append an operation; returns its number."""
        self.lines.append(" ".join(map(str, (self.count, *operation))))
        self.count += 1
        return self.count - 1

    def store(self, array: str, index: int, number: int) -> None:
        """Write a number to an array."""
        self.lines.append(f"store {array} {index} {number}")

    def text(self) -> str:
        """The whole code."""
        return "\n".join([*self.lines, "end\n"])


def _factorise(n: int, given: Places, filled: Places) -> str:
    write = _Lines("factorise")
    one, most = write("constant", 1.0), write("constant", _LARGEST_MULTIPLIER)
    refused = none = write("constant", 0.0)
    reach = write("negative", write("load", "reach", 0))
    # I - h·γ·J, of the entries that can be nonzero
    matrix = {(i, j): write("*", reach, write("load", "jacobian", i * n + j)) for i, j in sorted(given)}
    for k in range(n):
        matrix[k, k] = write("+", matrix[k, k], one) if (k, k) in matrix else one
    # the largest entry of each row in the units of the states: pressures and positions differ by twelve
    # orders of magnitude, which is no reason to exchange rows
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
            # a multiplier beyond the limit is counted rather than branched on; the kernel then factorises
            # again, with exchanges
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
