"""Check whether deciding code has changed since the method's version was declared.

python tools/method_version.py             says what the fingerprint is, and whether it is the declared one
python tools/method_version.py --changed   verdicts may come out differently: the next version
python tools/method_version.py --same      they cannot (a rewording, a renaming): the fingerprint alone

The search for formulas has a version and a fingerprint of its own. Each version is raised only where the code
behind it has changed.

The fingerprint is that of the syntax trees of every function, class and constant of the packages that affect
a verdict, without docstrings, comments, imports and annotations, in an order that does not depend on their
files.
"""

from __future__ import annotations

import argparse
import ast
import re
import sys
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path

ROOT = Path(__file__).parent.parent / "src" / "rigctl"
DECLARED = ROOT / "method_version.py"
#: packages that affect a verdict, from the import of a file to the text of the answer
PACKAGES = (
    "analysis",
    "dataset/importing",
    "effects",
    "engine",
    "families",
    "model",
    "noise",
    "physics",
)
#: packages that affect only what a search for formulas finds
SEARCHING = ("discovery",)
#: names of the declared version and fingerprint, and the packages behind them
DECLARATIONS = (
    ("METHOD_VERSION", "FINGERPRINT", PACKAGES),
    ("DISCOVERY_VERSION", "DISCOVERY_FINGERPRINT", SEARCHING),
)


def fingerprint(root: Path = ROOT, packages: tuple[str, ...] = PACKAGES) -> str:
    """Return twelve digits that change only with deciding code."""
    found = sorted(
        sha256(text.encode()).hexdigest()
        for package in packages
        for path in (root / package).rglob("*.py")
        for text in _statements(path)
    )
    return sha256("".join(found).encode()).hexdigest()[:12]


def _statements(path: Path) -> Iterator[str]:
    """Yield each effective statement of a module, as its syntax tree."""
    for statement in ast.parse(path.read_text(encoding="utf-8")).body:
        if not isinstance(statement, ast.Import | ast.ImportFrom) and not _for_types(statement) | _is_text(
            statement
        ):
            yield ast.dump(_Bare().visit(statement))


def _for_types(statement: ast.stmt) -> bool:
    return isinstance(statement, ast.If) and ast.unparse(statement.test) == "TYPE_CHECKING"


def _is_text(statement: ast.stmt) -> bool:
    return (
        isinstance(statement, ast.Expr)
        and isinstance(statement.value, ast.Constant)
        and isinstance(statement.value.value, str)
    )


class _Bare(ast.NodeTransformer):
    """Removes docstrings, imports and annotations from functions and classes."""

    def visit(self, node: ast.AST) -> ast.AST:
        body = getattr(node, "body", None)
        if isinstance(body, list):
            kept = [
                one for one in body if not _is_text(one) and not isinstance(one, ast.Import | ast.ImportFrom)
            ]
            node.body = kept or [ast.Pass()]  # type: ignore[attr-defined]
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            node.returns = None
        if isinstance(node, ast.arg):
            node.annotation = None
        return super().visit(node)


def declare(*, changed: bool) -> str:
    """Write the fingerprints that differ, with `changed` beside the next version; return the new lines."""
    text, lines = DECLARED.read_text(encoding="utf-8"), []
    for number, mark, packages in DECLARATIONS:
        found = fingerprint(packages=packages)
        version = int(re.search(rf"^{number} = (\d+)$", text, re.MULTILINE)[1])  # type: ignore[index]
        if f'\n{mark} = "{found}"' not in text and changed:
            version += 1
        text = re.sub(rf"^{number} = \d+$", f"{number} = {version}", text, flags=re.MULTILINE)
        text = re.sub(rf'^{mark} = ".*"$', f'{mark} = "{found}"', text, flags=re.MULTILINE)
        lines.append(f"{number} {version}, fingerprint {found}")
    DECLARED.write_text(text, encoding="utf-8")
    return "\n".join(lines)


def main() -> int:
    """Print or write the fingerprint."""
    parser = argparse.ArgumentParser(description="The version of the method that verdicts are reached by.")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--changed", action="store_true", help="verdicts may come out differently")
    which.add_argument("--same", action="store_true", help="they cannot")
    asked = parser.parse_args()
    if asked.changed or asked.same:
        print(declare(changed=asked.changed))
        return 0
    text = DECLARED.read_text(encoding="utf-8")
    same = all(f'\n{mark} = "{fingerprint(packages=each)}"' in text for _, mark, each in DECLARATIONS)
    print("as declared" if same else "deciding code has changed: --changed or --same says how")
    return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main())
