"""The page `docs/reference/python-names.md`, written from signatures and docstrings of the public names."""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Callable, Iterator
from types import ModuleType

_HEAD = """\
# Names of `import rigctl`

*Generated* from signatures and docstrings by `make docs`. [Python](python.md) shows them at work.

Importing `rigctl` imports nothing heavy; each name is loaded when it is first used.
"""
#: headings on the page for the sections of a docstring
_SECTIONS = {"Parameters": "Takes", "Attributes": "Has", "Returns": "Gives", "Raises": "Raises"}
_WIDTH = 100


def api_page() -> str:
    """Functions first, then classes, each in the order of the table."""
    import rigctl
    import rigctl.testing

    parts = [_HEAD]
    for title, kind in (("Functions", inspect.isfunction), ("Classes", inspect.isclass)):
        parts += [f"## {title}\n", *_entries("rigctl", rigctl, kind)]
    about = _code(inspect.getdoc(rigctl.testing) or "")
    parts.append(f"## rigctl.testing\n\n{about}\n")
    parts += _entries("rigctl.testing", rigctl.testing, lambda thing: not inspect.isclass(thing))
    parts += _entries("rigctl.testing", rigctl.testing, inspect.isclass)
    return "\n".join(parts).rstrip() + "\n"


def _entries(room: str, module: ModuleType, wanted: Callable[[object], bool]) -> Iterator[str]:
    public = ((name, getattr(module, name)) for name in module.__all__)
    return (_entry(room, name, thing) for name, thing in public if wanted(thing))


def _entry(room: str, name: str, thing: object) -> str:
    lines = [f"### {room}.{name}", ""]
    if inspect.isfunction(thing):
        lines += ["```python", signature_text(name, inspect.signature(thing)), "```", ""]
    lines += _docstring(inspect.getdoc(thing) or "")
    if inspect.isclass(thing):
        lines += _members(thing)
    return "\n".join(lines) + "\n"


def signature_text(name: str, signature: inspect.Signature) -> str:
    """Format the signature, with one parameter per line if it is long."""
    shown = [_parameter(one) for one in signature.parameters.values()]
    kinds = [one.kind for one in signature.parameters.values()]
    if inspect.Parameter.KEYWORD_ONLY in kinds and inspect.Parameter.VAR_POSITIONAL not in kinds:
        shown.insert(kinds.index(inspect.Parameter.KEYWORD_ONLY), "*")
    gives = (
        "" if signature.return_annotation is signature.empty else f" -> {_type(signature.return_annotation)}"
    )
    line = f"{name}({', '.join(shown)}){gives}"
    if len(line) <= _WIDTH:
        return line
    return f"{name}(\n" + "".join(f"    {one},\n" for one in shown) + f"){gives}"


def _parameter(one: inspect.Parameter) -> str:
    stars = {one.VAR_POSITIONAL: "*", one.VAR_KEYWORD: "**"}.get(one.kind, "")
    text = stars + one.name if one.annotation is one.empty else f"{stars}{one.name}: {_type(one.annotation)}"
    if one.default is one.empty:
        return text
    default = "…" if callable(one.default) else repr(one.default)
    return f"{text} = {default}"


def _type(annotation: object) -> str:
    return annotation if isinstance(annotation, str) else getattr(annotation, "__name__", str(annotation))


def _docstring(text: str) -> Iterator[str]:
    """Convert sections to lists of names with their descriptions."""
    section = ""
    lines = text.splitlines()
    for number, line in enumerate(lines):
        following = lines[number + 1] if number + 1 < len(lines) else ""
        if line.strip() in _SECTIONS and set(following.strip()) == {"-"}:
            section = line.strip()
            yield f"**{_SECTIONS[section]}**"
            yield ""
        elif section and line.strip() and set(line.strip()) == {"-"}:
            continue
        elif section in ("Parameters", "Attributes") and (entry := re.match(r"([\w*][\w*, ]*): (.*)", line)):
            names = ", ".join(f"`{name.strip()}`" for name in entry[1].split(","))
            yield f"- {names}: {_code(entry[2])}"
        elif section == "Raises" and re.fullmatch(r"\w+", line):
            yield f"- `{line}`:"
        elif section and line.startswith(" "):
            yield f"  {_code(line.strip())}"
        else:
            yield _code(line)
    yield ""


def _code(line: str) -> str:
    """Replace double backquotes by single ones."""
    return line.replace("``", "`")


def _members(kind: type) -> Iterator[str]:
    """Return the public methods and properties defined by the class, with their first lines."""
    fields = {one.name for one in dataclasses.fields(kind)} if dataclasses.is_dataclass(kind) else set()
    rows = []
    for name, member in vars(kind).items():
        if name.startswith(("_", "model_")) or name in fields:
            continue
        text = (inspect.getdoc(member) or "").partition("\n\n")[0].replace("\n", " ")
        function = getattr(member, "__func__", member)
        if inspect.isfunction(function) and text:
            called = inspect.signature(function)
            takes = [p.name for p in called.parameters.values() if p.name not in ("self", "cls")]
            rows.append(f"| `{name}({', '.join(takes)})` | {_code(text)} |")
        elif text and not inspect.isclass(member) and not isinstance(member, str | int | float | tuple):
            rows.append(f"| `{name}` | {_code(text)} |")
    if rows:
        yield from ("| | |", "|---|---|", *rows, "")
