"""A real browser for tests: headless Chromium, spoken to through its DevTools protocol."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.sync.connection import Connection

PATIENCE = 120.0  # seconds that a page may take to be ready, on a machine that does other things as well
QUIET = 0.7  # seconds without a request after which a page has come to rest
FORGOTTEN = 5.0  # seconds after which an open request is not waited for: the end of a worker's script is never told
FLAGS = (
    "--headless=new",
    "--no-sandbox",  # Chromium refuses to run as root with one
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-dev-shm-usage",
    "--disable-quic",
    "--disable-sync",
    "--hide-scrollbars",
    "--use-angle=swiftshader",  # WebGL without a graphics card
    "--enable-unsafe-swiftshader",
    "--remote-debugging-port=0",
)
NO_HOST_BUT_THIS = "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1, EXCLUDE localhost"


def find_chromium() -> str | None:
    """Return the program, or None where there is none."""
    for name in ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable"):
        if found := shutil.which(name):
            return found
    return None


needs_chromium = pytest.mark.skipif(
    find_chromium() is None, reason="there is no Chromium here (Debian: apt-get install chromium)"
)


@dataclass(frozen=True)
class Page:
    """What a browser saw of one page."""

    console_errors: list[str]  # also exceptions that nothing caught
    failed_requests: list[str]  # "reason url"; what the page itself cancelled is left out
    load_seconds: float  # from the request to the end of the page's `load` event, by the browser's own clock
    text: str  # what is visible, as text


@dataclass
class _Tab:
    """A connection to one tab, and what it has told so far."""

    connection: Connection
    console_errors: list[str] = field(default_factory=list)
    failed_requests: list[str] = field(default_factory=list)
    loaded: bool = False
    _urls: dict[str, str] = field(default_factory=dict)
    _open: dict[str, float] = field(default_factory=dict)
    _count: int = 0

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Run one command of the protocol and return its result; events on the way are kept."""
        self._count += 1
        self.connection.send(json.dumps({"id": self._count, "method": method, "params": parameters}))
        while True:
            message = json.loads(self.connection.recv(timeout=PATIENCE))
            if message.get("id") == self._count:
                if "error" in message:
                    raise RuntimeError(f"{method}: {message['error']['message']}")
                return dict(message["result"])
            self._take(message)

    def evaluate(self, expression: str) -> Any:
        """Return the value of a JavaScript expression, whose promise is waited for."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(f"{expression}: {answer['exceptionDetails']}")
        return answer["result"].get("value")

    def listen(self, seconds: float) -> bool:
        """Take events for so long; return whether the network was at rest."""
        end, quiet = time.monotonic() + seconds, self._rests()
        while (left := end - time.monotonic()) > 0:
            try:
                self._take(json.loads(self.connection.recv(timeout=left)))
            except TimeoutError:
                break
            quiet = quiet and self._rests()
        return quiet and self._rests()

    def _rests(self) -> bool:
        return all(time.monotonic() - begin > FORGOTTEN for begin in self._open.values())

    def _take(self, message: dict[str, Any]) -> None:
        content = message.get("params", {})
        match message.get("method"):
            case "Page.loadEventFired":
                self.loaded = True
            case "Runtime.exceptionThrown":
                details = content["exceptionDetails"]
                self.console_errors.append(details.get("exception", {}).get("description") or details["text"])
            case "Runtime.consoleAPICalled" if content["type"] in ("error", "assert"):
                words = [str(item.get("value", item.get("description", item["type"]))) for item in content["args"]]
                self.console_errors.append(" ".join(words))
            case "Log.entryAdded" if content["entry"]["level"] == "error":
                entry = content["entry"]
                self.console_errors.append(" ".join([entry["text"], entry.get("url", "")]).strip())
            case "Network.requestWillBeSent":
                self._urls[content["requestId"]] = content["request"]["url"]
                self._open[content["requestId"]] = time.monotonic()
            case "Network.responseReceived":
                if content["response"]["status"] >= 400:
                    self.failed_requests.append(f"{content['response']['status']} {content['response']['url']}")
            case "Network.loadingFinished":
                self._open.pop(content["requestId"], None)
            case "Network.loadingFailed":
                self._open.pop(content["requestId"], None)
                if not content.get("canceled"):
                    url = self._urls.get(content["requestId"], "")
                    self.failed_requests.append(f"{content['errorText']} {url}")


@contextmanager
def _tab(offline: bool) -> Iterator[_Tab]:
    program = find_chromium()
    assert program, "no Chromium; mark the test with needs_chromium"
    with tempfile.TemporaryDirectory(prefix="chromium-", ignore_cleanup_errors=True) as profile:
        command = [program, *FLAGS, f"--user-data-dir={profile}", *([NO_HOST_BUT_THIS] if offline else [])]
        process = subprocess.Popen([*command, "about:blank"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            with connect(_address(process, Path(profile)), max_size=None, proxy=None) as connection:
                yield _Tab(connection)
                with suppress(ConnectionClosed):
                    connection.send(json.dumps({"id": 0, "method": "Browser.close"}))
            process.wait(10)
        finally:
            process.kill()
            process.wait()


def _address(process: subprocess.Popen[bytes], profile: Path) -> str:
    """Return the address of the first tab; the port stands in a file that Chromium writes when it is ready."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        assert process.poll() is None, f"Chromium ended at once with exit code {process.returncode}"
        try:
            port = (profile / "DevToolsActivePort").read_text().split()[0]
            without_proxy = urllib.request.build_opener(urllib.request.ProxyHandler({}))
            with without_proxy.open(f"http://127.0.0.1:{port}/json/list", timeout=10) as answer:
                pages = [entry for entry in json.load(answer) if entry["type"] == "page"]
            if pages:
                return str(pages[0]["webSocketDebuggerUrl"])
        except (OSError, IndexError):
            pass
        time.sleep(0.1)
    raise TimeoutError("Chromium did not open its DevTools port")


def open_page(
    url: str,
    *,
    width: int,
    height: int,
    screenshot: Path | None = None,
    offline: bool = True,
    ready: str = "true",
    act: str = "",
) -> Page:
    """Open a page, wait until it has come to rest, and return what the browser saw.

    Args:
        url: of any scheme, `file://` too.
        width: of the window, pixels; and height.
        screenshot: PNG to write, of the window.
        offline: no name but this machine's resolves, and no address but this machine's is reached.
        ready: JavaScript expression that is true once the page shows what is looked for.
        act: JavaScript expression evaluated then, such as a click; the page comes to rest once more.

    Raises:
        TimeoutError: `ready` did not become true.
    """
    with _tab(offline) as tab:
        for domain in ("Page", "Runtime", "Log", "Network"):
            tab.call(f"{domain}.enable")
        tab.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        tab.call("Page.navigate", url=url)
        _rest(tab, ready)
        if act:
            tab.evaluate(act)
            _rest(tab, "true")
        if screenshot:
            picture = tab.call("Page.captureScreenshot", format="png")["data"]
            screenshot.write_bytes(base64.b64decode(picture))
        seconds = tab.evaluate("performance.getEntriesByType('navigation')[0].loadEventEnd / 1000")
        text = tab.evaluate("document.body.innerText")
        return Page(tab.console_errors, tab.failed_requests, float(seconds), str(text))


def _rest(tab: _Tab, ready: str) -> None:
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        if tab.listen(QUIET) and tab.loaded and tab.evaluate(f"Boolean({ready})"):
            return
    raise TimeoutError(f"the page did not come to rest with {ready} in {PATIENCE:.0f} s; it shows: {_shown(tab)}")


def _shown(tab: _Tab) -> str:
    return " ".join(str(tab.evaluate("document.body.innerText")).split())[:500]
