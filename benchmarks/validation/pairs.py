"""Two named effects that leave something: how many of the kept trials, and how often both are right.

``python -m benchmarks.validation.pairs`` counts them for decision 124. These are the trials on whose outcome
version 30 of the method can differ from version 29, and version 32 from version 31. With ``--alone`` those of
the tiers ``full`` and ``shape`` are diagnosed again, some five minutes, and the share that the better of the
two leaves alone is printed, for decision 127.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import get_args

from benchmarks.validation.page import FOLDER
from rigctl.analysis.search.refitted_sets import RefittedSets
from rigctl_validation.outcome import Trial, TrialOutcome
from rigctl_validation.scenario import Scenario
from rigctl_validation.store import every_outcome
from rigctl_validation.tier_definition import TierName, tier_definition
from rigctl_validation.work import diagnose_scenario


def leaves_something(outcome: TrialOutcome[Trial]) -> bool:
    """Whether the verdict names several effects that do not explain all of the misfit."""
    named = outcome.verdict in ("missing_effect", "ambiguous")
    return named and len(outcome.effects) > 1 and not outcome.all_of_it


def left_alone(outcome: TrialOutcome[Scenario]) -> float:
    """The share of the misfit that the better of the two effects leaves alone, within its shape tolerance."""
    diagnosis = diagnose_scenario(outcome.scenario, outcome.amplitudes)
    sets = RefittedSets(diagnosis.before, diagnosis.before.whole)
    members = {(name,) for name in diagnosis.effects}
    return min(sets.left(trial) for trial in diagnosis.trials if trial.effects in members)


def main(arguments: Sequence[str]) -> None:
    """Print the counts of each tier that is kept."""
    for tier in get_args(TierName):
        path = FOLDER / f"{tier}.jsonl"
        if not path.exists():
            continue
        trials = every_outcome(path, tier_definition(tier).read)
        pairs = [one for one in trials if leaves_something(one)]
        right = [sum(name in one.scenario.truth for name in one.effects) for one in pairs]
        print(
            f"{tier}: {len(pairs)} of {len(trials)} trials name two effects that leave something; "
            f"both are right in {right.count(2)}, one in {right.count(1)}, none in {right.count(0)}"
        )
        for one in pairs if "--alone" in arguments else ():
            if isinstance(one.scenario, Scenario):
                share = left_alone(one)
                print(
                    f"  {one.scenario.name}: {' + '.join(one.effects)}, the better alone leaves {share:.1%}"
                )


if __name__ == "__main__":
    main(sys.argv[1:])
