"""Which version of the tool a result is of: the text of everything that a verdict depends on."""

from __future__ import annotations

from functools import lru_cache
from hashlib import sha256
from pathlib import Path

import rigctl.errors as ground

#: packages of rigctl that a trial runs through
_PACKAGES = (
    "compare",
    "dataset/importing",
    "diagnose",
    "effects",
    "engine",
    "expressions",
    "families",
    "model",
    "noise",
    "physics",
    "validation",
)
#: what they consist of: code, and the files that the small benches' users write
_KINDS = (".py", ".yaml")


@lru_cache(maxsize=1)
def judged_version() -> str:
    """A fingerprint of these packages: results of other ones do not count."""
    root = Path(ground.__file__).parent
    digest = sha256()
    for package in _PACKAGES:
        for path in sorted(p for p in (root / package).rglob("*") if p.suffix in _KINDS):
            digest.update(path.relative_to(root).as_posix().encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:12]
