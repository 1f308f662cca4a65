"""Makes a player from a rig file and command options."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from rigctl.backends.options import refuse_unknown
from rigctl.backends.replay.player import Player
from rigctl.backends.replay.recording import Recording, read_recording
from rigctl.clock import Clock
from rigctl.errors import RigctlError
from rigctl.rig import Rig

OPTIONS = ("run", "runs")


def create(rig: Rig, clock: Clock, options: Mapping[str, object]) -> Player:
    """Make a player of a recorded run, not yet open.

    Parameters
    ----------
    rig: its channels are played back.
    clock: virtual, scaled or real.
    options: ``run`` (an id, the start of one, a path, or ``latest``), ``runs`` (the runs folder; by default
        the project's).

    Raises
    ------
    RigctlError
        an option is unknown, or no run is given or found.
    """
    from rigctl.dataset import open_run

    refuse_unknown("option of the replay backend", options, OPTIONS)
    reference, folder = options.get("run"), options.get("runs")
    if not isinstance(reference, str | Path) or not str(reference):
        raise RigctlError(
            "which run is to be played?", expected="a run's id or path, e.g. '--backend replay latest'"
        )
    run = open_run(str(reference), Path(str(folder)) if folder else None)

    def load() -> Recording:
        return read_recording(run, rig)

    return Player(rig, clock, load, {"run": run.id})
