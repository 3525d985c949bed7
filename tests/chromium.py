"""Headless Chromium, controlled through its DevTools pipe without a driver or a library."""

import base64
import json
import os
import select
import shutil
import subprocess
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

INSTALL_HINT = "Chromium is not installed; run: apt-get install -y chromium"
PROGRAM_NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--hide-scrollbars",
    "--remote-debugging-pipe",
)
WEBGPU_FLAGS = (
    *(flag for flag in FLAGS if flag != "--disable-gpu"),
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--enable-unsafe-webgpu",
    "--use-webgpu-adapter=swiftshader",
    "--enable-features=Vulkan",
)
"""WebGPU on SwiftShader, a rasteriser on the CPU that shares no code with Mesa."""

TIMEOUT_S = 180.0
"""Time limit for a reply or a condition, generous for machines under load."""

REPORT_READY = "document.documentElement?.dataset.ready !== undefined"
"""Condition that holds when the scripts of a report have drawn it."""

MEASUREMENT_ENDED = "['done', 'ended'].includes(document.documentElement?.dataset.state)"
"""Condition that holds when a measuring page has ended."""

LOADED = "document.readyState === 'complete'"
"""Condition that holds when all resources were requested and scripts have run."""


class Chromium:
    """A browser with one page; records errors and network requests of the page."""

    def __init__(self, flags: Sequence[str] = FLAGS) -> None:
        program = next((path for name in PROGRAM_NAMES if (path := shutil.which(name))), None)
        assert program, INSTALL_HINT
        self.errors: list[str] = []
        self.requests: list[str] = []
        self._profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        to_browser, self._out = os.pipe()
        self._in, from_browser = os.pipe()
        command = [program, *flags, f"--user-data-dir={self._profile.name}"]
        # Chromium reads commands from descriptor 3 and writes answers to descriptor 4.
        self._process = subprocess.Popen(
            ["bash", "-c", f'exec "$@" 3<&{to_browser} 4>&{from_browser}', "bash", *command],
            pass_fds=(to_browser, from_browser),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_browser)
        os.close(from_browser)
        self._buffer = b""
        self._number = 0
        self._session: str | None = None
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        attached = self.send("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.send(f"{domain}.enable")

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            reply = self._read()
            if reply.get("id") == self._number:
                assert "error" not in reply, f"{method}: {reply.get('error')}"
                return reply["result"]

    def _read(self) -> dict[str, Any]:
        deadline = time.monotonic() + TIMEOUT_S
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._in], [], [], max(0.0, deadline - time.monotonic()))
            assert ready, f"Chromium did not reply within {TIMEOUT_S:g} s"
            chunk = os.read(self._in, 1 << 20)
            assert chunk, "Chromium exited"
            self._buffer += chunk
        line, _, self._buffer = self._buffer.partition(b"\0")
        message = json.loads(line)
        self._note(message.get("method", ""), message.get("params", {}))
        return message

    def _note(self, event: str, parameters: dict[str, Any]) -> None:
        if event == "Runtime.exceptionThrown":
            details = parameters["exceptionDetails"]
            self.errors.append(details.get("exception", {}).get("description", details["text"]))
        elif event == "Runtime.consoleAPICalled" and parameters["type"] in ("error", "warning"):
            self.errors.append(str([argument.get("value") for argument in parameters["args"]]))
        elif event == "Log.entryAdded" and parameters["entry"]["level"] in ("error", "warning"):
            self.errors.append(parameters["entry"]["text"])
        elif event == "Network.requestWillBeSent":
            self.requests.append(parameters["request"]["url"])

    def open(self, file: Path, ready: str = REPORT_READY, fragment: str = "") -> None:
        """Open a file and wait until the JavaScript condition `ready` holds in it."""
        self.send("Page.navigate", url="about:blank")
        self.errors.clear()
        self.requests.clear()
        address = file.resolve().as_uri() + (f"#{fragment}" if fragment else "")
        self.send("Page.navigate", url=address)
        self.wait(f"location.href === {json.dumps(address)} && {ready}")

    def wait(self, condition: str) -> None:
        deadline = time.monotonic() + TIMEOUT_S
        while not self.evaluate(condition):
            assert not self.errors, self.errors
            if time.monotonic() > deadline:
                page_text = self.evaluate("document.body?.innerText.slice(0, 500)")
                raise AssertionError(f"timeout waiting for {condition}; page text: {page_text}")
            time.sleep(0.02)

    def evaluate(self, expression: str) -> Any:
        """Return the value of a JavaScript expression, after awaiting a promise."""
        result = self.send(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in result, result["exceptionDetails"]
        return result["result"].get("value")

    def read_text(self, part: str) -> str:
        """Return the text of an element of our pages by its id."""
        return self.evaluate(f"$('{part}').textContent")

    def resize(self, width: int, height: int) -> None:
        """Set the size of the viewport in CSS pixels."""
        self.send(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )

    def prefer(self, scheme: str) -> None:
        """Set the system's colour preference, "light" or "dark"."""
        feature = {"name": "prefers-color-scheme", "value": scheme}
        self.send("Emulation.setEmulatedMedia", features=[feature])

    def click(self, x: float, y: float) -> None:
        self.send("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
        for kind in ("mousePressed", "mouseReleased"):
            self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def press(self, key: str, code: int = 0, modifiers: int = 0) -> None:
        """Press and release a key, for example press("Tab", 9); modifiers=2 holds Ctrl."""
        text = {"Enter": "\r"}.get(key, "")
        for kind in ("keyDown", "keyUp"):
            self.send(
                "Input.dispatchKeyEvent",
                type=kind,
                key=key,
                code=key,
                text=text if kind == "keyDown" else "",
                windowsVirtualKeyCode=code,
                modifiers=modifiers,
            )

    def screenshot(self, file: Path, *, full_page: bool = True) -> Path:
        image = self.send("Page.captureScreenshot", captureBeyondViewport=full_page)
        file.write_bytes(base64.b64decode(image["data"]))
        return file

    def print(self, file: Path) -> Path:
        document = self.send("Page.printToPDF", printBackground=True)
        file.write_bytes(base64.b64decode(document["data"]))
        return file

    def close(self) -> None:
        self._session = None
        try:
            self.send("Browser.close")
        except AssertionError:
            self._process.kill()
        self._process.wait(timeout=30)
        os.close(self._out)
        os.close(self._in)
        self._profile.cleanup()
