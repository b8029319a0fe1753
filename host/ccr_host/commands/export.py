"""The command ``ccr-host export``."""

from __future__ import annotations

from typing import Annotated

import typer

from ccr_host.commands.options import JsonOption, OutOption, console_beside, print_json
from ccr_host.commands.replay import RunArgument
from ccr_host.core.errors import ConfigError

_WHOLE = {"mat": "rows", "rosbag2": "messages", "mcap": "messages"}
"""Formats that are no table a file, and what is counted in them."""


def export(
    run: RunArgument,
    form: Annotated[
        str,
        typer.Option(
            "--format",
            metavar="FORMAT",
            help="csv, parquet or jsonl; mat: for MATLAB and Octave; rosbag2: for ROS 2; "
            "mcap: repairs the log of a run that was killed.",
        ),
    ] = "csv",
    out: OutOption = None,
    as_json: JsonOption = False,
) -> None:
    """Write the log of a run as tables. Steps, commands, samples, states, frames, events.

    Example: ccr-host export runs/20260101-120000-ellipse-adaptive --format parquet
    """
    from ccr_host.core.user_file import is_folder
    from ccr_host.record.export import Format, finish_log, write_mat
    from ccr_host.record.export import export as export_tables
    from ccr_host.record.folder import ResultFolder
    from ccr_host.record.log.reader import RunRecording
    from ccr_host.record.ros_bag import write_bag

    if form not in (*Format, *_WHOLE):
        known = ", ".join((*Format, *_WHOLE))
        raise ConfigError(f"--format {form}: unknown", f"one of {known}")
    recording = RunRecording(run)
    beside = run if is_folder(run) else run.parent
    title = {"mcap": "finished", "rosbag2": "rosbag2"}.get(form, "tables")
    with ResultFolder(out or beside / title, title) as folder:
        match form:
            case "mcap":
                counts = {str(folder.path): finish_log(recording, folder.path)}
            case "mat":
                counts = write_mat(recording, folder.path)
            case "rosbag2":
                counts = write_bag(recording, folder.path)
            case _:
                written = export_tables(recording, Format(form), folder.path)
                counts = {str(path): count for path, count in written}
    screen = console_beside(as_json=as_json)
    for what, count in counts.items():
        screen.print(f"{what}: {count} {_WHOLE.get(form, 'rows')}")
    if form in ("mat", "rosbag2"):
        screen.print(f"saved in {folder.path}", soft_wrap=True)
    if recording.end.trouble:
        screen.print(f"{recording.end.trouble}; exported up to there", soft_wrap=True)
    if as_json:
        print_json(counts)
