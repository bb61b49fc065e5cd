# SPDX-License-Identifier: GPL-3.0-or-later
"""Fixtures of all tests: no network, and a process end safe from hangs in Blender."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import sys
import tempfile
from collections.abc import Iterator
from functools import partial

import hypothesis
import pytest

# How long an example takes is no result: the machine may be busy.
hypothesis.settings.register_profile(
    "hfx", deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile("hfx")

# No user device configurations: a missing folder, unless a test names a folder.
os.environ["HFX_DEVICES"] = os.path.join(os.path.dirname(__file__), "no-devices")

# No user data, such as time on and approved scripts.
_own_data = tempfile.TemporaryDirectory(prefix="hfx-tests-", ignore_cleanup_errors=True)
os.environ["XDG_DATA_HOME"] = os.environ["APPDATA"] = _own_data.name

# Tests started in the background of a shell ignore Ctrl-C, as do the child processes.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True)
def _no_network(monkeypatch: pytest.MonkeyPatch) -> None:
    connect = socket.socket.connect

    def guarded(self: socket.socket, address: object) -> None:
        if isinstance(address, tuple) and address[0] not in ("127.0.0.1", "::1", "localhost"):
            raise AssertionError(f"a test tried to reach {address}")
        connect(self, address)  # type: ignore[arg-type]

    monkeypatch.setattr(socket.socket, "connect", guarded)


@pytest.fixture
def patient_devices(monkeypatch: pytest.MonkeyPatch) -> None:
    """Disable deadlines of live devices, for busy machines."""
    import patient_host

    from hfx_blender.processes import start

    monkeypatch.setattr(start, "command", partial(patient_host.command, of=start.command))


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config: pytest.Config) -> Iterator[None] | None:
    # Blender's module sometimes hangs at Python's exit; all results are written by now.
    if "bpy" in sys.modules:
        from hfx_tools.command_process.blender_module import remove_temporary_files

        temporary = sys.modules["bpy"].app.tempdir.rstrip(os.sep)
        if os.path.basename(temporary).startswith("blender_"):  # not the user's own folder
            shutil.rmtree(temporary, ignore_errors=True)
        remove_temporary_files()
        settings = os.environ.get("BLENDER_USER_RESOURCES", "")
        if os.path.basename(settings).startswith("hfx_test_"):
            shutil.rmtree(settings, ignore_errors=True)
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(getattr(config, "hfx_exit_status", 0))
    return None


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    session.config.hfx_exit_status = int(exitstatus)  # type: ignore[attr-defined]
