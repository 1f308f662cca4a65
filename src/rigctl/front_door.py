"""Packages that are called: ``rigctl.compare(...)`` is the function of that name inside the package."""

from __future__ import annotations

from importlib import import_module
from inspect import Signature, signature
from types import ModuleType
from typing import Any


class CallablePackage(ModuleType):
    """A package ``p`` that, called, is the function ``p.p.p``.

    Importing a package puts it into its parent under its own name, where a function of the same name would
    be lost; so the package itself is called. The function is imported with the first call.
    """

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Call the function."""
        return self._function()(*arguments, **named)

    @property
    def __signature__(self) -> Signature:
        return signature(self._function())

    def _function(self) -> Any:
        own = self.__name__.rpartition(".")[2]
        return getattr(import_module(f"{self.__name__}.{own}"), own)
