# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure the served page in Chromium: message to vibration, and silence after the last message.

``python tests/manual/players/check_page.py [CHROMIUM]`` records calls of ``navigator.vibrate`` and
of a simulated gamepad, and prints percentiles in ms.
"""

import json
import subprocess
import sys
import tempfile
import time
import urllib.request

import numpy as np
from websockets.sync.client import connect

from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.transports.page_output import PageOutput

STUB = """
window.calls = []; window.came = 0; window.count = 0;
const Real = WebSocket;
window.WebSocket = class extends Real {
  constructor(...a) { super(...a); this.addEventListener("message", () => {
    window.came = performance.now(); window.count++; }); }
};
const note = (kind, on) => window.calls.push([kind, on, performance.now() - window.came]);
navigator.vibrate = (p) => (note("phone", p !== 0), true);
const pad = { index: 0, id: "double", vibrationActuator: { playEffect: (t, e) => {
  note("pad", e.strongMagnitude + e.weakMagnitude > 0); return Promise.resolve("complete"); } } };
navigator.getGamepads = () => [pad];
"""


def main() -> None:
    browser = sys.argv[1] if len(sys.argv) > 1 else "chromium"
    output = PageOutput(load_device("phone_lra"), "127.0.0.1", 0, "123456")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        options = "--headless=new --no-sandbox --disable-gpu --no-first-run".split()
        options += ["--remote-debugging-port=9333", f"--user-data-dir={profile}", "about:blank"]
        child = subprocess.Popen([browser, *options], stderr=subprocess.DEVNULL)
        try:
            _check(output)
        finally:
            child.terminate()
            child.wait(10)
            output.close()


def _check(output: PageOutput) -> None:
    for _ in range(100):
        try:
            tabs = json.load(urllib.request.urlopen("http://127.0.0.1:9333/json", timeout=2))
            break
        except OSError:
            time.sleep(0.2)
    socket = connect(next(t for t in tabs if t["type"] == "page")["webSocketDebuggerUrl"])
    number = 0

    def call(method: str, **parameters: object) -> dict:
        nonlocal number
        number += 1
        socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while (answer := json.loads(socket.recv(timeout=20))).get("id") != number:
            pass
        return answer["result"]

    def run(script: str) -> object:
        answer = call("Runtime.evaluate", expression=script, returnByValue=True, userGesture=True)
        return answer["result"].get("value")

    call("Page.enable")
    call("Page.addScriptToEvaluateOnNewDocument", source=STUB)
    call("Page.navigate", url=output.chosen_device.split()[0])
    time.sleep(2.0)
    run("code.value = '123456'; feel.click()")
    time.sleep(1.0)
    say = sys.stdout.write
    say(f"{run('state.textContent')!r} {run('means.textContent')!r}\n")
    for k in range(1000):
        output.send(np.array([1.0 + 8.0 * (k % 2), 175.0]))
        time.sleep(0.01)
    time.sleep(0.02)
    came = run("performance.now() - came")
    before = run("calls.length")
    time.sleep(0.6)
    calls = run("calls")
    for kind in ("phone", "pad"):
        delays = [ms for name, on, ms in calls[:before] if name == kind and on]
        say(f"{kind}: {len(delays)} calls, p50 {np.percentile(delays, 50):.2f} ms, ")
        say(f"p99 {np.percentile(delays, 99):.2f} ms\n")
        last = next((ms for name, on, ms in calls[before:] if name == kind and not on), None)
        say(f"{kind}: silent {last} ms after the last message ({came:.0f} ms at the end)\n")
    output.send(np.array([5.0, 175.0]))
    time.sleep(0.05)
    output.close()
    time.sleep(0.2)
    say(f"after the end: {run('calls.slice(-2)')}\n")


if __name__ == "__main__":
    main()
