"""A real headless Chromium for tests, spoken to over a pipe (the DevTools protocol): no driver."""

import base64
import itertools
import json
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
ANSWER_S = 30.0
WITHOUT = "no Chromium here: install one (Debian: apt-get install chromium)"
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-extensions",
    "--hide-scrollbars",
    "--remote-debugging-pipe",
)
KEYS = {" ": ("Space", 32), "Enter": ("Enter", 13), "Escape": ("Escape", 27)}


def chromium() -> str | None:
    """Return the path of a Chromium; None: there is none."""
    named = os.environ.get("JUNCNET_CHROMIUM")
    return named or next((path for name in NAMES if (path := shutil.which(name))), None)


needs_chromium = pytest.mark.skipif(chromium() is None, reason=WITHOUT)


class Browser:
    """A Chromium with one page; a context."""

    def __init__(self, width: int = 1280, height: int = 800) -> None:
        self._size = (width, height)
        self._ids = itertools.count(1)
        self._buffer = b""
        self.problems: list[str] = []
        """Errors and warnings that the page wrote to its console, and exceptions."""

    def __enter__(self) -> "Browser":
        path = chromium()
        assert path is not None, WITHOUT
        self._profile = tempfile.TemporaryDirectory(prefix="jn-browser-")
        to_browser, self._write = os.pipe()
        self._read, from_browser = os.pipe()

        def wire() -> None:  # the browser reads from descriptor 3 and writes to 4
            os.dup2(to_browser, 103)
            os.dup2(from_browser, 104)
            os.dup2(103, 3)
            os.dup2(104, 4)

        command = ["nice", "-n", "10", path, *FLAGS, f"--user-data-dir={self._profile.name}"]
        self._process = subprocess.Popen(
            [*command, "about:blank"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            preexec_fn=wire,
            pass_fds=(3, 4, to_browser, from_browser),
            start_new_session=True,
        )
        os.close(to_browser)
        os.close(from_browser)
        targets = self._call("Target.getTargets")["targetInfos"]
        target = next(t["targetId"] for t in targets if t["type"] == "page")
        attached = self._call("Target.attachToTarget", {"targetId": target, "flatten": True})
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")
        self.resize(*self._size)
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self._call("Browser.close")
            self._process.wait(10)
        except (OSError, subprocess.TimeoutExpired, AssertionError):
            os.killpg(self._process.pid, 9)
            self._process.wait(10)
        os.close(self._write)
        os.close(self._read)
        self._profile.cleanup()

    def call(self, method: str, **params: Any) -> Any:
        """Call a DevTools method of the page and return its result."""
        return self._call(method, params, self._session)

    def _call(
        self, method: str, params: dict[str, Any] | None = None, session: str | None = None
    ) -> Any:
        number = next(self._ids)
        message: dict[str, Any] = {"id": number, "method": method, "params": params or {}}
        if session is not None:
            message["sessionId"] = session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._receive()
            if answer.get("id") == number:
                assert "error" not in answer, f"{method}: {answer['error']}"
                return answer["result"]
            self._note(answer)

    def _receive(self) -> dict[str, Any]:
        deadline = time.monotonic() + ANSWER_S
        while b"\0" not in self._buffer:
            assert time.monotonic() < deadline, "Chromium does not answer"
            part = os.read(self._read, 1 << 20)
            assert part, "Chromium has ended"
            self._buffer += part
        message, _, self._buffer = self._buffer.partition(b"\0")
        return json.loads(message)

    def _note(self, event: dict[str, Any]) -> None:
        params: dict[str, Any] = event.get("params", {})
        match event.get("method"):
            case "Runtime.exceptionThrown":
                details = params["exceptionDetails"]
                thrown = details.get("exception", {}).get("description", details["text"])
                self.problems.append(thrown)
            case "Runtime.consoleAPICalled" if params["type"] in ("error", "warning"):
                self.problems.append(str([a.get("value") for a in params["args"]]))
            case "Log.entryAdded" if params["entry"]["level"] == "error":
                self.problems.append(f"{params['entry']['text']} {params['entry'].get('url', '')}")
            case _:
                pass

    def open(self, url: str) -> None:
        """Open an address; the problems of the page before are forgotten."""
        self.call("Page.navigate", url="about:blank")
        self.run("1")
        self.problems.clear()
        self.call("Page.navigate", url=url)

    def resize(self, width: int, height: int, mobile: bool = False) -> None:
        """Give the page this size, in CSS pixels."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=mobile,
        )

    def prefer(self, scheme: str) -> None:
        """Let the user prefer `light` or `dark`."""
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        self.call("Emulation.setEmulatedMedia", features=features)

    def run(self, script: str) -> Any:
        """Return the value of a JavaScript expression; promises are waited for."""
        answer = self.call(
            "Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def text(self, selector: str) -> str:
        """Return the text that an element shows; empty: there is none."""
        return str(self.run(f"document.querySelector({json.dumps(selector)})?.innerText ?? ''"))

    def until(self, script: str, limit_s: float = 15.0) -> None:
        """Wait until a JavaScript expression holds; while a page loads it may fail."""
        deadline = time.monotonic() + limit_s
        tried = f"(() => {{ try {{ return !!({script}) }} catch {{ return false }} }})()"
        while not self.run(tried):
            assert time.monotonic() < deadline, f"not within {limit_s:g} s: {script}"
            time.sleep(0.05)

    def until_text(self, selector: str, text: str, limit_s: float = 15.0) -> None:
        """Wait until an element shows `text` somewhere."""
        element = f"document.querySelector({json.dumps(selector)})"
        self.until(f"{element}.innerText.includes({json.dumps(text)})", limit_s)

    def press(self, key: str) -> None:
        """Press and release a key."""
        code, number = KEYS.get(key) or (f"Key{key.upper()}", ord(key.upper()))
        fields = {"key": key, "code": code, "windowsVirtualKeyCode": number}
        text = {} if len(key) > 1 else {"text": key}
        self.call("Input.dispatchKeyEvent", type="keyDown", **fields, **text)
        self.call("Input.dispatchKeyEvent", type="keyUp", **fields)

    def click(self, selector: str) -> None:
        """Press an element with the mouse, where it can be seen."""
        x, y = self.run(
            "(() => { const e = document.querySelector(" + json.dumps(selector) + ");"
            "e.scrollIntoView({block: 'nearest'}); const r = e.getBoundingClientRect();"
            "return [r.x + r.width / 2, r.y + r.height / 2]; })()"
        )
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def picture(self, path: Path) -> None:
        """Save what the page shows as PNG."""
        data = self.call("Page.captureScreenshot", format="png")["data"]
        path.write_bytes(base64.b64decode(data))


def overflowing(browser: Browser, but: Sequence[str] = ()) -> list[str]:
    """Return the elements that reach beyond the page's width, but those that may."""
    found: list[str] = browser.run(
        "[...document.querySelectorAll('body *')].filter(e => e.offsetParent !== null && "
        "e.getBoundingClientRect().right > innerWidth + 1 && !e.closest('#strip, nav, table'))"
        ".map(e => e.tagName + '#' + e.id)"
    )
    return [name for name in found if name not in but]
