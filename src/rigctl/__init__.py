"""rigctl: run physical test benches, compare a model with what was measured, learn what is missing."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rigctl.dataset import open_run as open_run
    from rigctl.runner.simulation import simulate as simulate

#: public names, and the module each comes from; imported when first used, so that 'import rigctl' is light
_PUBLIC = {"open_run": "rigctl.dataset", "simulate": "rigctl.runner.simulation"}

__all__ = ["open_run", "simulate"]


def __getattr__(name: str) -> Any:
    """The public name, from the module that defines it."""
    if name not in _PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_PUBLIC[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_PUBLIC})
