"""rigctl: run physical test benches, compare a model with what was measured, learn what is missing."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rigctl.compare.compare import compare as compare
    from rigctl.dataset import open_run as open_run
    from rigctl.diagnose.diagnose import diagnose as diagnose
    from rigctl.model import load_model as load_model
    from rigctl.runner.simulation import simulate as simulate

#: public names, and the module each comes from; imported when first used, so that 'import rigctl' is light
_PUBLIC = {
    "load_model": "rigctl.model",
    "open_run": "rigctl.dataset",
    "simulate": "rigctl.runner.simulation",
}
#: packages that are called themselves
_CALLED = ("compare", "diagnose")

__all__ = ["compare", "diagnose", "load_model", "open_run", "simulate"]


def __getattr__(name: str) -> Any:
    """The public name, from the module that defines it."""
    if name in _CALLED:
        return import_module(f"{__name__}.{name}")
    if name not in _PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_PUBLIC[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_CALLED, *_PUBLIC})
