"""The rates of the kept trials, put into the page of the documentation on how often a diagnosis is right.

`rigctl validate --tier shape --resume --out benchmarks/validation` adds the missing trials of a tier.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path
from typing import get_args

from rigctl_validation.outcome import Trial, TrialOutcome
from rigctl_validation.store import ResultStore
from rigctl_validation.tables import page as rates_page
from rigctl_validation.tier_definition import TierName, tier_definition

FOLDER = Path(__file__).parent
_BLOCK = re.compile(
    r"(<!-- rates of the tier (?P<tier>\w+): make docs -->\n).*?(<!-- end of rates -->\n)", re.DOTALL
)
_SOURCE = "\nMade with {versions}; every trial is in `benchmarks/validation/{tier}.jsonl`.\n"
_NOT_RUN = (
    "Not yet run with this version: `rigctl validate --tier {tier} --resume --out benchmarks/validation`.\n"
)
#: meaning of the parts of a stored version
_PARTS = {"method": "the method", "discovery": "the search for formulas"}


def with_rates(page: Path) -> str:
    """The page's text with the rates of the kept trials between its marks."""
    text = page.read_text(encoding="utf-8")
    return _BLOCK.sub(lambda block: block[1] + rates(_tier(block["tier"])) + block[3], text)


def rates(tier: TierName) -> str:
    """The tables of a tier, of the trials kept from the version of the method that made the last one.

    Only trials before the first missing one count: these are a representative sample.
    """
    definition = tier_definition(tier)
    path = FOLDER / f"{tier}.jsonl"
    lines = list(ResultStore(path, "", definition.read).lines())
    if not lines:
        return f"\n{_NOT_RUN.format(tier=tier)}\n"
    version = lines[-1]["version"]
    kept = {each.scenario.name: each for each in ResultStore(path, version, definition.read).outcomes()}
    first = [kept[trial.name] for trial in takewhile(lambda trial: trial.name in kept, definition.trials)]
    source = _SOURCE.format(versions=_versions(version), tier=tier)
    return f"\n{rates_page(definition.figures(first), _command(tier, first, definition.trials))}{source}\n"


def _versions(stored: str) -> str:
    """``method 27, discovery 2`` in words."""
    parts = [part.split() for part in stored.split(", ")]
    return " and ".join(f"version {number} of {_PARTS[name]}" for name, number in parts)


def _command(tier: TierName, first: Sequence[TrialOutcome[Trial]], trials: Sequence[Trial]) -> str:
    limit = f" --first {len(first)}" if len(first) < len(trials) else ""
    return f"rigctl validate --tier {tier}{limit}"


def _tier(name: str) -> TierName:
    return next(tier for tier in get_args(TierName) if tier == name)
