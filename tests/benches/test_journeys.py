"""From the log of a user's bench to a corrected model, with documented commands only.

Ten benches other than hydraulic cylinders. The log of each comes from a generator that shares no code with
rigctl's models; family, rig and model are files as a user writes them.
"""

from __future__ import annotations

import math
from contextlib import chdir
from pathlib import Path

import pytest

from commands import answer, told
from rigctl_validation.benches.bench import BenchCampaign, Sampling, write_bench
from rigctl_validation.benches.register import BENCHES, find_bench

pytestmark = pytest.mark.usefixtures("shared_results")

#: amplitude of the hidden effect: λ of about 100 by `python -m rigctl_validation.benches NAME --hide`. In the
#: others it is hidden by ``rigctl validate --tier anyone``, with each of several sizes.
HIDDEN = {
    "motor": 0.0046,
    "pendulum": 0.01,
    "chain": 0.089,
    "exchanger": 1.45,
    "battery": 0.019,
    "belt": 0.12,
}
#: oscillates: with few samples, the residual between two of them masks the noise
FAST = {"pendulum"}
#: whether the verdict must be a single effect, or may be a class that these data cannot separate
ALONE = {"chain", "exchanger", "belt", "pendulum"}


#: benches whose integration takes long: how many of the records before the held-out ones are in the log
FEWER = {"exchanger": 3, "chamber": 3}
#: and whose pairs of effects only ``rigctl validate --tier anyone`` tries
SINGLE = dict.fromkeys(FEWER, ("--max-effects", "1"))


def project(folder: Path, name: str, amplitude: float) -> Path:
    """A user's project with the log in it."""
    told("init", str(folder), "--minimal")
    sampling: Sampling = "fast" if amplitude and name in FAST else "slow"
    campaign = BenchCampaign(find_bench(name), amplitude, sampling, seed=0)
    log = write_bench(campaign, folder)
    if name in FEWER:
        heading, *lines = log.read_text(encoding="utf-8").splitlines(keepends=True)
        kept = [line for line in lines if not FEWER[name] < int(line.split(",")[1]) <= 5]
        log.write_text("".join([heading, *kept]), encoding="utf-8", newline="\n")
    return log


@pytest.mark.parametrize("name", list(BENCHES))
def test_the_model_of_a_bench_without_a_hidden_effect_is_adequate(name: str, tmp_path: Path) -> None:
    log = project(tmp_path / "mine", name, 0.0)
    with chdir(tmp_path / "mine"):
        told("import", str(log), "--rig", "rig.yaml")
        found = answer("diagnose", "latest", "--model", "model.yaml")
    assert found["verdict"] == "adequate", found["statement"]


@pytest.mark.parametrize("name", list(HIDDEN))
def test_a_hidden_effect_is_found_and_adding_it_reduces_the_error_on_held_out_records(
    name: str, tmp_path: Path
) -> None:
    bench = find_bench(name)
    log = project(tmp_path / "mine", name, HIDDEN[name])
    with chdir(tmp_path / "mine"):
        told("import", str(log), "--rig", "rig.yaml")
        held_out = ("--hold-out", bench.hold_out)
        found = answer("diagnose", "latest", "--model", "model.yaml", *held_out, *SINGLE.get(name, ()))
        assert found["verdict"] in ("missing_effect", "ambiguous"), found["statement"]
        if name in ALONE - {"chain"}:  # of the chain two losses fit as well, and both are named
            assert found["verdict"] == "missing_effect", found["statement"]
        assert len(found["effects"]) == 1, found["statement"]
        named = {*found["effects"], *(member for group in found["classes"] for member in group)}
        right = named & set(bench.hidden.counts_as)
        assert right, found["statement"]
        added = answer("model", "add", "model.yaml", min(right), "--fit", "latest", *held_out)
    before, after = added["before"]["heldout_rmse"], added["after"]["heldout_rmse"]
    gain = [math.log(after[channel] / before[channel]) for channel in before]
    assert min(gain) < -0.02
    assert sum(gain) < 0.0
