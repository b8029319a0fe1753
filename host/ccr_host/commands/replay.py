"""The command ``ccr-host replay``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ccr_host.commands.options import JsonOption, complete_controllers, console_beside, print_json
from ccr_host.core.errors import CcrError

RunArgument = Annotated[
    Path, typer.Argument(metavar="RUN", help="Folder of a run, or one file of its log.")
]


class DifferentReplayError(CcrError):
    """The host no longer sends what it sent in the run (exit status 3)."""


def replay(
    run: RunArgument,
    controller: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Use instead of the recorded one, for instance if its file was moved.",
            autocompletion=complete_controllers,
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Run the host on recorded inputs again and compare. Its output must match byte for byte.

    Example: ccr-host replay runs/20260101-120000-ellipse-adaptive
    """
    from ccr_host.record.folder import versions
    from ccr_host.record.log.reader import RunRecording
    from ccr_host.record.replay import replay as replay_run

    screen = console_beside(as_json=as_json)
    recording = RunRecording(run)
    written_by, ours = recording.setup["versions"], versions()
    changed = {key: old for key, old in written_by.items() if ours.get(key) != old}
    if changed:
        listed = ", ".join(f"{key} {old} (now {ours.get(key)})" for key, old in changed.items())
        screen.print(f"written by other versions: {listed}")
    result = replay_run(recording, controller=controller)
    if recording.end.trouble:
        screen.print(f"{recording.end.trouble}; compared up to there", soft_wrap=True)
    difference = result.difference
    if as_json:
        print_json(
            {
                "equal": difference is None,
                "complete": recording.end.is_complete,
                "frames": result.frames,
                "steps": result.steps,
                "duration_s": result.end_us * 1e-6,
                "written_by": written_by,
                "difference": None if difference is None else vars(difference),
            }
        )
    if difference is not None:
        raise DifferentReplayError(
            f"{run}: differs at {difference.time_us * 1e-6:.6f} s, "
            f"after {difference.steps_done} steps and {result.frames} equal frames: "
            f"{difference.what}",
        )
    screen.print(
        f"equal: {result.frames} frames sent in {result.steps} steps, {result.end_us * 1e-6:.2f} s",
    )
