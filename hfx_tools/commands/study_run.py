# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx study run``: session of a participant on devices, on a page in full screen."""

from __future__ import annotations

import argparse
import datetime
import platform
import time
import webbrowser
from contextlib import ExitStack, closing
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from hfx_blender.commands.arguments import add_json
from hfx_blender.commands.console import Console
from hfx_blender.errors import DeviceError, UsageError
from hfx_blender.version import __version__

from .play import add_output_arguments, check_outputs, connect, fault_of_log

if TYPE_CHECKING:
    from ..study.folder import Study
    from ..study.session import Session
    from ..study.stimuli import StimulusLibrary

_FAREWELL_S: Final = 1.0


def add_parser(actions: Any) -> None:
    parser = actions.add_parser(
        "run",
        help="run a participant's session",
        description="Run the session of a participant: a page in full screen for keyboard and "
        "gamepad, and stimuli on devices with their limits and stops. Esc stops; the same command "
        "continues after the last answer.",
    )
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder of 'hfx study make'")
    parser.add_argument(
        "--participant",
        metavar="NN",
        help="number of the participant (default: the first one without all answers)",
    )
    add_output_arguments(parser, needs_device=False)
    parser.add_argument(
        "--listen-on",
        default="127.0.0.1",
        metavar="ADDRESS",
        help="own address of --to page (default: 127.0.0.1)",
    )
    parser.add_argument(
        "--page-port", type=int, default=0, metavar="PORT", help="port of the session's page"
    )
    parser.add_argument(
        "--no-browser", action="store_true", help="print the address instead of opening a browser"
    )
    add_json(parser, run)


def run(options: argparse.Namespace, console: Console) -> int:
    """Run a session to its end or the participant's stop; returns 0. DeviceError for a device that
    failed; answers stay in every case."""
    from hfx_blender.devices.configuration import load_device
    from hfx_blender.devices.live.client import LiveClient
    from hfx_blender.files import resources

    from ..command_process.signal_watch import at_signals
    from ..study.answers import AnswerFile
    from ..study.device_player import DevicePlayer
    from ..study.folder import Study
    from ..study.page_server import PagePresenter
    from ..study.session import Session, event_columns
    from ..study.stimuli import StimulusLibrary, devices_of

    study = Study(options.folder)
    names = devices_of(study.plan, options.device or ())
    check_outputs(options, names)
    participant = _participant(study, options.participant)
    write_note = console.warn if console.as_json else console.say
    with ExitStack() as stack:
        stimuli = StimulusLibrary(study, names, console.progress("stimuli"))
        path = study.data_file(participant)
        answers = stack.enter_context(AnswerFile(path, event_columns(study.plan)))
        study.write_participants()
        devices = {name: load_device(name, resources.user_devices()) for name in names}
        presenter = PagePresenter(study.plan.noise, options.page_port)
        stack.enter_context(closing(presenter))
        client = stack.enter_context(closing(LiveClient()))
        stack.enter_context(at_signals(client.stop_all))
        for name, device in devices.items():
            connect(client, name, (device, None), options, write_note)
        player = DevicePlayer(client, devices)
        session = Session(study, participant, stimuli, player, presenter, answers)
        presenter.show({"kind": "wait", "text": "The devices are being connected."})
        write_note(f"participant {participant}, session {session.number}: {presenter.address}")
        if not options.no_browser:
            webbrowser.open(presenter.address)
        begun = datetime.datetime.now(datetime.UTC)
        try:
            player.wait_ready()
            _write_sidecar(study, participant, session, stimuli, options, begun)
            is_complete = session.run()
        except DeviceError as error:
            text = "A device failed. The session has ended; all answers are stored."
            presenter.show({"kind": "end", "text": text})
            time.sleep(_FAREWELL_S)
            raise fault_of_log(options.path, client) or error from error
        finally:
            client.stop_all("the session has ended")
            _write_sidecar(study, participant, session, stimuli, options, begun)
        count = len(answers.rows)
        # The page shows its last text before the port is closed.
        time.sleep(_FAREWELL_S)
    state = "complete" if is_complete else "stopped; the same command continues"
    console.say(f"{path}: {count} answers, {state}")
    console.result({"participant": participant, "answers": count, "complete": is_complete})
    return 0


def _participant(study: Study, given: str | None) -> str:
    """Label of the participant: the given one, or the first without all answers. UsageError if all
    participants are complete."""
    from ..study.folder import label_of
    from ..study.tables import read_table

    if given is not None:
        return study.label(given)
    for number in range(1, study.plan.participants + 1):
        label = label_of(number)
        path = study.data_file(label)
        if not path.exists():
            return label
        done = sum(row["trial_type"] in ("trial", "catch") for row in read_table(path))
        if done < len(study.trials(label)[1]):
            return label
    raise UsageError(
        f"{study.folder}: all {study.plan.participants} participants have answered; name a further "
        "one with --participant"
    )


def _write_sidecar(
    study: Study,
    participant: str,
    session: Session,
    stimuli: StimulusLibrary,
    options: argparse.Namespace,
    begun: datetime.datetime,
) -> None:
    """Write the description of a participant's answers: columns, and facts of each session."""
    import json

    from ..study.column_texts import described
    from ..study.folder import write_json

    path = study.data_file(participant, "_events.json")
    try:
        earlier = list(json.loads(path.read_text(encoding="utf-8"))["Sessions"])
    except (OSError, ValueError, KeyError, TypeError):  # none yet, or changed by hand
        earlier = []
    latencies = sorted(session.latencies_ms)
    facts = {
        "Session": session.number,
        "Begin": begun.strftime("%Y-%m-%dT%H:%M:%SZ"),
        "Devices": stimuli.device_ids,
        "Output": options.to,
        "MeasuredLatency": {
            "Description": "time from the session to the port, milliseconds",
            "Count": len(latencies),
            "Median": round(latencies[len(latencies) // 2], 3) if latencies else None,
            "Highest": round(latencies[-1], 3) if latencies else None,
        },
        "Versions": {"hfx": __version__, "Python": platform.python_version()},
        "StimulusHashes": stimuli.hashes,
    }
    sessions = [one for one in earlier if dict(one).get("Session") != session.number]
    write_json(
        path,
        {
            **described(study.plan),
            "TaskName": study.task,
            "TaskDescription": study.plan.title,
            "Instructions": study.plan.texts["welcome"],
            "StimulusPresentation": {
                "OperatingSystem": f"{platform.system()} {platform.release()}",
                "SoftwareName": "hfx",
                "SoftwareVersion": __version__,
            },
            "Sessions": [*sessions, facts],
        },
    )
