"""The command ``ccr-host export``."""

from __future__ import annotations

from typing import Annotated

import typer

from ccr_host.commands.options import JsonOption, OutOption, console, print_json
from ccr_host.commands.replay import RunArgument
from ccr_host.core.errors import ConfigError

_FINISHED_LOG = "mcap"


def export(
    run: RunArgument,
    form: Annotated[
        str,
        typer.Option(
            "--format",
            metavar="FORMAT",
            help="csv, parquet or jsonl; mcap: repairs the log of a run that was killed.",
        ),
    ] = "csv",
    out: OutOption = None,
    as_json: JsonOption = False,
) -> None:
    """Write the log of a run as tables. Steps, commands, samples, states, frames, events.

    Example: ccr-host export runs/20260101-120000-ellipse-adaptive --format parquet
    """
    from ccr_host.core.user_file import is_folder
    from ccr_host.record.export import Format, finish_log
    from ccr_host.record.export import export as export_tables
    from ccr_host.record.folder import ResultFolder
    from ccr_host.record.log.reader import RunRecording

    if form not in (*Format, _FINISHED_LOG):
        known = ", ".join((*Format, _FINISHED_LOG))
        raise ConfigError(f"--format {form}: unknown", f"one of {known}")
    recording = RunRecording(run)
    beside = run if is_folder(run) else run.parent
    title = "finished" if form == _FINISHED_LOG else "tables"
    with ResultFolder(out or beside / title, title) as folder:
        if form == _FINISHED_LOG:
            counts = {str(folder.path): finish_log(recording, folder.path)}
        else:
            written = export_tables(recording, Format(form), folder.path)
            counts = {str(path): count for path, count in written}
    screen = console(on_stderr=as_json)
    for path, count in counts.items():
        what = "messages" if form == _FINISHED_LOG else "rows"
        screen.print(f"{path}: {count} {what}")
    if recording.end.trouble:
        screen.print(f"{recording.end.trouble}; exported up to there", soft_wrap=True)
    if as_json:
        print_json(counts)
