"""Faults, small changes of the syntax tree of a module, and how one is planted in a running process."""

from __future__ import annotations

import ast
import gc
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

ROOT = Path(__file__).parent.parent
SOURCE = ROOT / "src" / "rigctl"

_COMPARED: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
_COMPUTED: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}
_CALLED = {"min": "max", "max": "min", "any": "all", "all": "any", "floor": "ceil", "ceil": "floor"}
#: statements that may be left out; without an assignment to a name, the next line would only fail
_LEFT_OUT = (ast.Expr, ast.AugAssign, ast.Raise, ast.Continue, ast.Break, ast.Delete)
_REACHED = "__reached__"
#: a smaller number is a tolerance, for which twice as much means nothing
_TOLERANCE = 1e-6
#: longest text of a change; of a longer statement only the changed expression is shown
_LONGEST = 110


@dataclass(frozen=True)
class Fault:
    """One change of one file.

    Attributes
    ----------
    lines: first and last line of the statement, or of the header of a compound one.
    where: the function, with its class.
    change: the statement or expression, before and after; with `file` and `where` it identifies the fault, in
        whatever line it is.
    inside: whether it is in the body of a function; otherwise it changes a constant, a class or a default.
    plant: changes the syntax tree.
    """

    file: str
    lines: tuple[int, int]
    where: str
    change: str
    inside: bool
    plant: Callable[[], None]

    @property
    def key(self) -> tuple[str, str, str]:
        """Its identity in `mutants.toml`."""
        return self.file, self.where, self.change


def faults(file: str, tree: ast.Module) -> Iterator[Fault]:
    """Yield every fault of a module, in a fixed order."""
    yield from _Walk(file).of(tree)


class _Walk:
    """Walks a syntax tree, with the place that it has reached."""

    def __init__(self, file: str) -> None:
        self._file = file
        self._names: list[str] = []
        self._inside = False
        self._shown: list[ast.AST] = []  # the statement or header, and the expressions down to this place

    def of(self, node: ast.AST) -> Iterator[Fault]:
        for field, value in ast.iter_fields(node):
            for index, child in enumerate(value if isinstance(value, list) else [value]):
                if isinstance(child, ast.AST) and not _wording(node, field, child):
                    yield from self._child(node, field, index if isinstance(value, list) else None, child)

    def _child(self, parent: ast.AST, field: str, index: int | None, child: ast.AST) -> Iterator[Fault]:
        before = self._names, self._inside, self._shown
        if isinstance(child, ast.stmt):
            self._shown = []
        if isinstance(child, ast.expr) or (isinstance(child, ast.stmt) and not hasattr(child, "body")):
            self._shown = [*self._shown, child]
        if isinstance(parent, ast.FunctionDef):
            self._inside = self._inside or field == "body"
        if isinstance(child, ast.FunctionDef | ast.ClassDef):
            self._names = [*self._names, child.name]
        if isinstance(child, ast.expr | ast.stmt):
            for other in _instead(parent, field, child):
                yield self._fault(parent, field, index, child, other)
        yield from self.of(child)
        self._names, self._inside, self._shown = before

    def _fault(self, parent: ast.AST, field: str, index: int | None, child: ast.AST, other: ast.AST) -> Fault:
        def put(node: ast.AST) -> None:
            if index is None:
                setattr(parent, field, node)
            else:
                getattr(parent, field)[index] = node

        outer: list[ast.AST] = self._shown[:-1] if self._shown and self._shown[-1] is child else self._shown
        context = next((one for one in outer if len(ast.unparse(one)) <= _LONGEST), child)
        ast.copy_location(other, child)
        ast.fix_missing_locations(other)
        old = ast.unparse(context)
        put(other)
        new = ast.unparse(other if context is child else context)
        put(child)
        first = outer[0] if outer else child
        lines = (first.lineno, first.end_lineno or first.lineno)  # type: ignore[attr-defined]
        where = ".".join(self._names)
        return Fault(self._file, lines, where, f"{old} -> {new}", self._inside, lambda: put(other))


def _wording(parent: ast.AST, field: str, child: ast.AST) -> bool:
    """Whether a part of the tree is no behaviour: a type, a decorator, a docstring, a message, a check."""
    if isinstance(child, ast.keyword) and child.arg == "strict":
        return True
    if field in ("annotation", "returns", "decorator_list", "bases") or isinstance(child, ast.JoinedStr):
        return True
    if isinstance(parent, ast.Raise) or (
        isinstance(child, ast.Expr) and isinstance(child.value, ast.Constant)
    ):
        return True
    checking = isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING"
    return checking or isinstance(child, ast.Import | ast.ImportFrom | ast.Assert)


def _instead(parent: ast.AST, field: str, node: ast.AST) -> Iterator[ast.AST]:  # noqa: C901, PLR0912 - a list
    """Yield what may be put in the place of a node."""
    if isinstance(node, _LEFT_OUT) or (
        isinstance(node, ast.Assign)
        and not any(isinstance(one, ast.Name | ast.Tuple) for one in node.targets)
    ):
        yield ast.Pass()
    if isinstance(parent, ast.If | ast.IfExp) and field == "test":
        yield from (ast.Constant(True), ast.Constant(False))
    if isinstance(parent, ast.comprehension) and field == "ifs":
        yield ast.Constant(True)
    match node:
        case ast.Compare(left, ops, comparators):
            for at, operator in enumerate(ops):
                for other in _COMPARED[type(operator)]:
                    yield ast.Compare(left, [*ops[:at], other(), *ops[at + 1 :]], comparators)
        case ast.BoolOp(operator, values):
            yield ast.BoolOp(ast.Or() if isinstance(operator, ast.And) else ast.And(), values)
            for at in range(len(values)):
                rest = [*values[:at], *values[at + 1 :]]
                yield rest[0] if len(rest) == 1 else ast.BoolOp(operator, rest)
        case ast.UnaryOp(ast.Not() | ast.USub(), operand):
            yield operand
        case ast.BinOp(left, operator, right) if type(operator) in _COMPUTED and not _text(left, right):
            yield ast.BinOp(left, _COMPUTED[type(operator)](), right)
        case ast.AugAssign(target, operator, value) if type(operator) in _COMPUTED and not _text(value):
            yield ast.AugAssign(target, _COMPUTED[type(operator)](), value)
        case ast.Call(ast.Name("abs"), [argument]):
            yield argument
        case ast.Call(ast.Name(name), arguments, keywords) if name in _CALLED:
            yield ast.Call(ast.Name(_CALLED[name], ast.Load()), arguments, keywords)
        case ast.Call(ast.Attribute(value, name), arguments, keywords) if name in _CALLED:
            yield ast.Call(ast.Attribute(value, _CALLED[name], ast.Load()), arguments, keywords)
        case ast.Constant(bool(value)):
            yield ast.Constant(not value)
        case ast.Constant(int(value)):
            yield ast.Constant(value + 1)
        case ast.Constant(float(value)):
            yield ast.Constant(1e-3 if 0.0 < value <= _TOLERANCE else 2.0 * value or 1.0)
        case ast.Constant(str(value)) if isinstance(parent, ast.Compare | ast.Return):
            yield ast.Constant(value + "?")


def _text(*nodes: ast.AST) -> bool:
    """Whether one of the operands is a text: there is no difference of texts."""
    return any(
        isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str))
        for node in nodes
    )


# --- replacing code in a running process


class Planter:
    """Replaces code of modules that are imported already.

    A function keeps its identity and gets new code, so that it is changed wherever it was imported. Of what
    is not in a function, plain values are replaced in every module that has them by the same name, and
    defaults in the functions; what another module has computed from them at its import is not.
    """

    def __init__(self, files: Sequence[str]) -> None:
        gc.unfreeze()  # the tests' own settings hide what was there before from the garbage collector
        self._trees = {file: ast.parse((SOURCE / file).read_text(encoding="utf-8")) for file in files}
        self._functions: dict[str, dict[tuple[str, int], list[FunctionType]]] = {file: {} for file in files}
        names = {str(SOURCE / file): file for file in files}
        for one in gc.get_objects():
            # `isinstance` would ask a weak reference for its object, which may be gone
            if type(one) is FunctionType and one.__code__.co_filename in names:
                known = self._functions[names[one.__code__.co_filename]]
                known.setdefault(_place(one.__code__), []).append(one)

    def faults(self) -> list[Fault]:
        """Every fault of the files."""
        return [one for file, tree in self._trees.items() for one in faults(file, tree)]

    def plant(self, fault: Fault) -> bool:
        """Change this process; return whether anything in it has changed."""
        path = SOURCE / fault.file
        fault.plant()
        code = compile(self._trees[fault.file], str(path), "exec")
        changed = self._replace(fault.file, code)
        if not fault.inside:
            changed = self._constants(path, code, self._functions[fault.file]) or changed
        self.forget()
        return changed

    def probe(self, reached: Callable[[str, int, int], None]) -> None:
        """Let each statement in a function first call `reached` with its file and its first and last line."""
        for file, tree in self._trees.items():
            for function in ast.walk(tree):
                if isinstance(function, ast.FunctionDef):
                    _probe(function)
            code = compile(ast.fix_missing_locations(tree), str(SOURCE / file), "exec")
            self._replace(file, code)
            for functions in self._functions[file].values():
                functions[0].__globals__[_REACHED] = partial(reached, file)

    @staticmethod
    def forget() -> None:
        """Empty the caches of functions; one with a single entry holds what is dear to create, and stays."""
        for module in list(sys.modules.values()):
            for value in list(vars(module).values()) if _ours(module) else ():
                if hasattr(value, "cache_parameters") and value.cache_parameters()["maxsize"] != 1:
                    value.cache_clear()

    def _replace(self, file: str, code: CodeType) -> bool:
        """Give functions the code of the same place; return whether any had another."""
        found = [
            (function, inner)
            for inner in _codes(code)
            for function in self._functions[file].get(_place(inner), ())
            if _differs(function.__code__, inner)
        ]
        for function, inner in found:
            function.__code__ = inner
        return bool(found)

    @staticmethod
    def _constants(path: Path, code: CodeType, functions: dict[tuple[str, int], list[FunctionType]]) -> bool:
        module = next(m for m in list(sys.modules.values()) if getattr(m, "__file__", None) == str(path))
        fresh = {key: value for key, value in vars(module).items() if key.startswith("__")}
        exec(code, fresh)
        pairs = [(name, vars(module)[name], value) for name, value in fresh.items() if name in vars(module)]
        changed = False
        for name, old, new in pairs:
            if _plain(old) and _plain(new) and repr(old) != repr(new):
                changed = True
                for other in list(sys.modules.values()):
                    if _ours(other) and vars(other).get(name) is old:
                        setattr(other, name, new)
            if isinstance(old, type) and isinstance(new, type):
                changed = _attributes(old, new) or changed
        for one in gc.get_objects():
            if isinstance(one, FunctionType) and one.__globals__ is fresh:
                for function in functions.get(_place(one.__code__), ()):
                    changed = _defaults(function, one) or changed
        return changed


def _probe(node: ast.AST) -> None:
    """Put a call before every statement of a function, but not of the functions in it."""
    for field in ("body", "orelse", "finalbody", "handlers", "cases"):
        statements = getattr(node, field, None)
        if not isinstance(statements, list):
            continue
        probed: list[ast.AST] = []
        for one in statements:
            if not isinstance(one, ast.FunctionDef | ast.ClassDef):
                _probe(one)
            if isinstance(one, ast.stmt):
                last = one.body[0].lineno - 1 if getattr(one, "body", None) else one.end_lineno
                arguments = [ast.Constant(one.lineno), ast.Constant(max(last or 0, one.lineno))]
                call = ast.Call(ast.Name(_REACHED, ast.Load()), arguments, [])
                probed.append(ast.copy_location(ast.Expr(call), one))
            probed.append(one)
        setattr(node, field, probed)


def _ours(module: Any) -> bool:
    file = getattr(module, "__file__", None)
    return isinstance(file, str) and file.startswith((str(SOURCE), str(ROOT / "tests")))


def _place(code: CodeType) -> tuple[str, int]:
    return code.co_qualname, code.co_firstlineno


def _codes(code: CodeType) -> Iterator[CodeType]:
    for one in code.co_consts:
        if isinstance(one, CodeType):
            yield one
            yield from _codes(one)


def _differs(one: CodeType, other: CodeType) -> bool:
    """Whether two codes do not do the same; equality of code objects compares their positions too."""
    if one.co_code != other.co_code or one.co_names != other.co_names:
        return True
    pairs = list(zip(one.co_consts, other.co_consts, strict=False))
    if len(one.co_consts) != len(other.co_consts):
        return True
    return any(
        _differs(a, b) if isinstance(a, CodeType) and isinstance(b, CodeType) else repr(a) != repr(b)
        for a, b in pairs
    )


def _plain(value: object) -> bool:
    if isinstance(value, tuple | list | frozenset | set):
        return all(map(_plain, value))
    if isinstance(value, dict):
        return all(map(_plain, value)) and all(map(_plain, value.values()))
    return value is None or isinstance(value, int | float | str | bytes | re.Pattern)


def _attributes(old: type, new: type) -> bool:
    """Give a class the plain attributes of another, and its `__init__` the defaults."""
    changed = False
    for name, value in list(vars(new).items()):
        before = vars(old).get(name)
        if isinstance(value, FunctionType) and isinstance(before, FunctionType):
            changed = _defaults(before, value) or changed
        elif not name.startswith("__") and _plain(value) and _plain(before) and repr(value) != repr(before):
            setattr(old, name, value)
            changed = True
    return changed


def _defaults(old: FunctionType, new: FunctionType) -> bool:
    """Give a function the plain defaults of another; those that are objects of classes stay its own."""
    changed = False
    pairs = zip(old.__defaults__ or (), new.__defaults__ or (), strict=False)
    values = tuple(value if _plain(value) and _plain(before) else before for before, value in pairs)
    if repr(values) != repr(old.__defaults__ or ()):
        old.__defaults__, changed = values, True
    for name, value in (new.__kwdefaults__ or {}).items():
        before = (old.__kwdefaults__ or {}).get(name)
        if _plain(value) and _plain(before) and repr(value) != repr(before):
            old.__kwdefaults__, changed = {**(old.__kwdefaults__ or {}), name: value}, True
    return changed
