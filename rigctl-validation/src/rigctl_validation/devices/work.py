"""One trial of several devices from the bench to the verdict, by a run as the tool keeps it."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeAlias

import numpy as np

from rigctl.analysis.diagnosis import diagnose
from rigctl.analysis.diagnosis_result import Diagnosis
from rigctl.dataset import open_run
from rigctl.engine.one_thread import one_thread
from rigctl.engine.result_cache import switched_off
from rigctl_validation.bench.campaign import Campaign, generator, recorded_channels
from rigctl_validation.campaign_run import make_run
from rigctl_validation.devices.trial import DEVICES, UNMEASURED, DevicesTrial
from rigctl_validation.outcome import TrialOutcome
from rigctl_validation.work import bench_model, hidden_amplitudes

DevicesOutcome: TypeAlias = TrialOutcome[DevicesTrial]

#: random stream of a campaign from which the errors of measured ages are drawn; records have those from 1 on
_MEASURED = 1000


@one_thread()
@switched_off()
def carry_out_devices(trial: DevicesTrial) -> DevicesOutcome:
    """Keep the campaign as a run of one device or of several, diagnose it, and return the outcome.

    Raises
    ------
    RigctlError
        the tool cannot diagnose the run.
    """
    began = time.process_time()
    found = hidden_amplitudes(trial.scenario)
    outcome = TrialOutcome(
        trial,
        sizes=tuple(each.size for each in found),
        amplitudes=tuple(each.value for each in found),
    )
    if not all(each.reached for each in found):
        return replace(outcome, untested="no amplitude has the size wanted")
    with TemporaryDirectory() as folder:
        diagnosis = diagnose_devices(trial, trial.scenario.campaign(outcome.amplitudes), Path(folder))
    return replace(
        outcome,
        verdict=diagnosis.verdict.value,
        effects=diagnosis.effects,
        classes=diagnosis.classes,
        first=diagnosis.ranking[0].effect if diagnosis.ranking else None,
        explained_by=diagnosis.before.explained_by or "",
        seconds=time.process_time() - began,
    )


def diagnose_devices(trial: DevicesTrial, campaign: Campaign, folder: Path) -> Diagnosis:
    """The diagnosis of a campaign that is read as the trial says, and kept as a run in `folder`."""
    model, rig = bench_model(trial.scenario.chamber_pressures)
    assert rig.path is not None  # noqa: S101 - it was loaded from a file
    path = folder / "rig.yaml"
    devices = () if trial.reading == "one" else tuple(DEVICES)
    clocks = "".join(f"{line}\n" for line in _clocks(trial, campaign)) if devices else ""
    path.write_text(f"{rig.path.read_text(encoding='utf-8')}\n{clocks}", encoding="utf-8", newline="\n")
    return diagnose([open_run(make_run(campaign, path, folder, devices=devices))], model)


def _clocks(trial: DevicesTrial, campaign: Campaign) -> list[str]:
    """What the rig file says of the devices' clocks: the age of each, with the error of its measurement."""
    rng, lines = generator(campaign.seed, _MEASURED), ["clocks:"]
    for turn, (device, uncertainty) in enumerate(DEVICES.items()):
        measured = -device.age + 0.5 * uncertainty * float(np.clip(rng.standard_normal(), -2.0, 2.0))
        stated = f"offset: {1e3 * measured:.4g} ms, uncertainty: {1e3 * uncertainty:g} ms"
        if trial.reading == "shifted" and turn == 0:
            stated = f"uncertainty: {1e3 * UNMEASURED:g} ms"
        channels = [name for name in device.channels if name in recorded_channels(campaign)]
        if channels:
            lines.append(f"  {device.name}: {{channels: [{', '.join(channels)}], {stated}}}")
    return lines
