"""Mistakes in a call, in one style: each names the option or argument whose value is wrong.

What the library of the command line finds by itself becomes a `RigctlError`. What a command finds later knows
the value and seldom the option, which is looked for among the values that were given.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from enum import Enum
from functools import wraps
from itertools import product
from pathlib import Path
from typing import Any, Final, get_args, get_origin

import typer

from rigctl.errors import RigctlError, SeveralErrors, unknown_name

#: what a value of each type is called
_KINDS: Final[Mapping[object, str]] = {int: "a whole number", float: "a number"}
_NUMBER: Final = re.compile(r"[-+]?[.,]?\d[\d.,]*(e[-+]?\d+)?", re.IGNORECASE)


@contextmanager
def one_style() -> Iterator[None]:
    """Raise the library's errors as `RigctlError`; what is no error, such as a help text, passes.

    Raises
    ------
    RigctlError
        an option or argument is unknown or missing, or its value is of the wrong kind.
    """
    try:
        yield
    except typer.BadParameter as error:  # this one and its base classes are the library's
        raise _as_ours(error) from error
    except Exception as error:
        if getattr(error, "exit_code", None) != 2 or "NoArgsIsHelp" in type(error).__name__:
            raise
        if isinstance(error, RigctlError | typer.Exit):
            raise
        raise _as_ours(error) from error


def name_parameters(command: Any) -> None:
    """Make the errors of a command name the option or argument concerned, and refuse empty values."""
    written: dict[str, list[str]] = {}
    for param in command.params:
        param.process_value = _refusing_empty(param, written)
    carry_out = command.callback

    @wraps(carry_out)
    def naming(**given: Any) -> Any:
        try:
            return carry_out(**given)
        except RigctlError as error:
            raise _named(error, command.params, written) from error.__cause__

    command.callback = naming


def _refusing_empty(param: Any, written: dict[str, list[str]]) -> Callable[[Any, Any], Any]:
    """Process a value of the parameter as before, unless it is empty, and keep what was `written` for it."""
    process = param.process_value

    def checked(context: Any, value: Any) -> Any:
        source = context.get_parameter_source(param.name)
        values = value if isinstance(value, list | tuple) else [value]
        given = source is not None and source.name == "COMMANDLINE"
        texts = [one for one in values if isinstance(one, str)] if given else []
        written[param.name] = texts
        if "" in texts:
            raise RigctlError(f"{_shown_name(param)} is empty", expected=_described(param))
        try:
            return process(context, value)
        except RigctlError as error:  # of the option's own callback
            raise _named(error, [param], written) from error.__cause__

    return checked


def _named(error: RigctlError, params: Sequence[Any], written: Mapping[str, list[str]]) -> RigctlError:
    """The error with the name of the parameter whose value it quotes, unless it has one already."""
    names = [name for one in params for name in (*one.opts, *one.secondary_opts) if name.startswith("--")]
    if isinstance(error, SeveralErrors) or error.where.line or any(name in error.what for name in names):
        return error  # the file and line, or the option, say where
    path = str(error.where.file) if error.where.file else ""
    for fits, quoted in product((_is, _holds), (error.value, path)):
        about = [one for one in params if any(fits(text, quoted or "") for text in written.get(one.name, ()))]
        if len(about) == 1:
            if quoted is path and not _shown_name(about[0]).startswith("--"):
                return error  # the message begins with the file, which is the only thing it can be about
            error.what = f"{_shown_name(about[0])}: {error.what}"
            break
    return error


def _is(text: str, quoted: str) -> bool:
    return text.strip() == quoted.strip() != ""


def _holds(text: str, quoted: str) -> bool:
    """Whether a written value contains the words that a message quotes, or is the relative form of its path.

    A bare number may stand for anything: it is no option's unless it is the whole value.
    """
    words = quoted.strip()
    if not words or _NUMBER.fullmatch(words):
        return False
    before, behind = r"(?<![\w.])" * words[0].isalnum(), r"(?!\w)" * words[-1].isalnum()
    found = re.search(f"{before}{re.escape(words)}{behind}", text)
    return found is not None or quoted == str(Path.cwd() / text)


def _as_ours(error: Any) -> RigctlError:
    context: Any = getattr(error, "ctx", None)
    called = context.command_path if context is not None else ""  # "python -m rigctl runs" too
    path = f"rigctl{called.rpartition('rigctl')[2]}"
    hint = f"'{path} --help' describes the call" if context is not None else None
    param = getattr(error, "param", None)
    option = getattr(error, "option_name", None)
    if param is not None:
        return _wrong_value(error, param, hint)
    if type(error).__name__ == "NoSuchOption":
        names = [name for one in context.command.params for name in (*one.opts, *one.secondary_opts)]
        named = [name for name in (*names, "--help") if name.startswith("--")]
        unknown = unknown_name("option", str(option), named)
        unknown.expected, unknown.hint = None, hint
        if re.match(r"-[.\d]", str(option)):
            unknown.hint = "'--' before a value that begins with '-' marks it as a value"
        return unknown
    text = str(error.message).rstrip(".")
    nested = getattr(getattr(context, "command", None), "commands", None)
    if nested and "command" in text and (typed := re.search(r"'(.*?)'", text)):
        return unknown_name(f"command of '{path}'", typed.group(1), nested)
    if option is not None:
        missing = "requires" in text or "argument" in text
        return RigctlError(
            f"{option}: its value is missing" if missing else f"{option} takes no value", hint=hint
        )
    return RigctlError(text[:1].lower() + text[1:], hint=hint)


def _wrong_value(error: Any, param: Any, hint: str | None) -> RigctlError:
    """The error for a value that is missing or of the wrong kind."""
    name = _shown_name(param)
    if type(error).__name__ == "MissingParameter":
        return RigctlError(f"{name} is missing", expected=_described(param), hint=hint)
    values = [one["input"] for one in getattr(error.__cause__, "errors", list)()]
    value = next((str(one) for one in values), None)
    kind = _plain_type(param)
    if isinstance(kind, type) and issubclass(kind, Enum):
        return unknown_name(f"value of {name}", value or "", [str(one.value) for one in kind])
    if kind not in _KINDS:
        return RigctlError(f"{name}: {str(error.message).rstrip('.')}", value=value, hint=hint)
    return RigctlError(f"{name}: wrong value", value=value, expected=_KINDS[kind] + _range(param))


def _shown_name(param: Any) -> str:
    """The name of an option or argument, as the help shows it."""
    if param.param_type_name == "option":
        return str(max(param.opts, key=len))
    return str(param.metavar or param.name.upper()).strip("[].")


def _described(param: Any) -> str | None:
    """The help text of an option or argument as a description of valid values."""
    text = (getattr(param, "help", None) or "").rstrip(".")
    return text[:1].lower() + text[1:] if text[1:2].islower() else text or None


def _plain_type(param: Any) -> Any:
    """The type of one value: int of ``list[int] | None``."""
    kind = getattr(getattr(param, "type_descriptor", None), "annotation", None)
    while get_origin(kind) is not None:
        kind = next((one for one in get_args(kind) if one is not type(None)), None)
    return kind


def _range(param: Any) -> str:
    low, high = getattr(param, "min", None), getattr(param, "max", None)
    if low is not None and high is not None and high < 2**31:
        return f" from {low:g} to {high:g}"
    if low is not None:
        return f", {low:g} or more"
    return ""
