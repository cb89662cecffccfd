"""A plain browser shows a running cell: nothing to install and nothing to type behind the address."""

from __future__ import annotations

import base64
import io
import json
import os
import re
import shutil
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

from services.viewer import colours

PROGRAM = next((path for path in map(shutil.which, ("chromium", "chromium-browser", "google-chrome")) if path), None)
PATIENCE_S = 200.0
WIDTH, HEIGHT = 1000, 660
AXES = (colours.SKY_BLUE, colours.ORANGE, colours.GREEN)
PLOTS = (0.30, 0.66, 0.06, 0.70)
"""Where the curves are: left, right, top, bottom, in parts of the picture."""
SWITCHES = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--hide-scrollbars",
    "--remote-debugging-pipe",
)
Picture = npt.NDArray[np.uint8]


class Browser:
    """A browser without a screen, steered over its debugging pipe: JSON, a zero byte after each message."""

    def __init__(self, program: str, profile: Path, width: int = WIDTH, height: int = HEIGHT) -> None:
        reads, self._to = os.pipe()
        self._from, writes = os.pipe()
        # It expects the pipe as files 3 and 4.
        command = ["bash", "-c", f'exec "$@" 3<&{reads} 4>&{writes}', "bash", program, *SWITCHES]
        command += [f"--user-data-dir={profile}", "about:blank"]
        with (profile / "said").open("wb") as said:
            self.process = subprocess.Popen(
                command, pass_fds=(reads, writes), stdin=subprocess.DEVNULL, stdout=said, stderr=said
            )
        os.close(reads)
        os.close(writes)
        # Nothing below waits for ever: when it ends, so does what is read from it.
        self._overdue = threading.Timer(PATIENCE_S, self.process.kill)
        self._overdue.start()
        self._rest = b""
        self._count = 0
        self._events: set[str] = set()
        self._page: dict[str, str] = {}
        found: list[dict[str, str]] = []
        while not found:
            found = [one for one in self.ask("Target.getTargets")["targetInfos"] if one["type"] == "page"]
        attached = self.ask("Target.attachToTarget", targetId=found[0]["targetId"], flatten=True)
        self._page = {"sessionId": attached["sessionId"]}
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.ask("Emulation.setDeviceMetricsOverride", **size)

    def ask(self, method: str, **parameters: object) -> Any:
        """Call a method of the debugging protocol and return its result."""
        self._count += 1
        question = {"id": self._count, "method": method, "params": parameters, **self._page}
        os.write(self._to, json.dumps(question).encode() + b"\0")
        while (answer := self._next()).get("id") != self._count:
            self._events.add(str(answer.get("method")))
        assert "error" not in answer, answer
        return answer["result"]

    def load(self, url: str) -> None:
        """Go to a page and return when it is there, whatever it goes on to load by itself."""
        self.ask("Page.enable")
        self._events.clear()
        self.ask("Page.navigate", url=url)
        while "Page.loadEventFired" not in self._events:
            self._events.add(str(self._next().get("method")))

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            piece = os.read(self._from, 1 << 20)
            assert piece, f"the browser ended, or was not done within {PATIENCE_S:g} s"
            self._rest += piece
        message, _, self._rest = self._rest.partition(b"\0")
        received: dict[str, Any] = json.loads(message)
        return received

    def shot(self) -> bytes:
        """Return what it shows, as PNG."""
        return base64.b64decode(self.ask("Page.captureScreenshot", format="png")["data"])

    def close(self) -> None:
        """End it."""
        self._overdue.cancel()
        os.close(self._to)
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        os.close(self._from)


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Browser]:
    if PROGRAM is None:
        pytest.skip("no Chromium on this machine (apt install chromium)")
    profile = tmp_path / "profile"
    profile.mkdir()
    opened = Browser(PROGRAM, profile)
    yield opened
    opened.close()


def share(picture: Picture, left: float, right: float, top: float, bottom: float) -> Picture:
    """Return a part of a picture; edges as parts of its width and height."""
    high, wide, _ = picture.shape
    return picture[round(top * high) : round(bottom * high), round(left * wide) : round(right * wide)]


def count(part: Picture, colour: tuple[int, int, int], within: int = 24) -> int:
    """Return how many pixels have about a colour."""
    return int((np.abs(part.astype(np.int64) - colour).max(axis=2) <= within).sum())


def missing(picture: Picture) -> list[str]:
    """Return what a picture of the whole layout lacks, by the colours where they belong."""
    scene, table = share(picture, 0.0, 0.28, 0.06, 0.55), share(picture, 0.0, 0.28, 0.65, 0.93)
    forces, torques = share(picture, 0.30, 0.66, 0.06, 0.28), share(picture, 0.30, 0.66, 0.48, 0.70)
    marks, learnt = share(picture, 0.30, 0.66, 0.72, 0.96), share(picture, 0.68, 1.0, 0.06, 0.27)
    bars, log = share(picture, 0.68, 1.0, 0.44, 0.66), share(picture, 0.68, 1.0, 0.70, 0.93)
    peg = (scene[:, :, 2] > scene[:, :, 0].astype(np.int64) + 60).sum()  # blue, in any light
    yellow = (table.max(axis=2) > table.min(axis=2).astype(np.int64) + 60).sum()
    found = {
        "the peg": int(peg) > 1000,
        "the action values": int(yellow) > 3000,
        "the curves of the forces": all(count(forces, colour) > 60 for colour in AXES),
        "the curves of the torques": all(count(torques, colour) > 20 for colour in AXES),
        "the contact states": count(marks, colours.SKY_BLUE) > 15,
        "the mean return": count(learnt, colours.YELLOW) > 30,
        "the bars": (bars[:, :, 2] > bars[:, :, 0].astype(np.int64) + 60).sum() > 200,
        "the log": (log.max(axis=2) > 120).sum() > 150,
    }
    return [what for what, there in found.items() if not there]


@pytest.mark.timeout(240)
def test_a_browser_shows_the_running_cell(
    browser: Browser,
    up: Callable[..., Any],
    endpoint_of: Callable[[Path], str],
    run_module: Callable[..., Any],
    wait_until: Callable[..., None],
    tmp_path: Path,
) -> None:
    out = tmp_path / "run"
    up(out, 100_000)
    free = ("--bind", "127.0.0.1", "--port", "0", "--web-port", "0")
    viewer = run_module("services.viewer", "--connect", endpoint_of(out), *free)
    wait_until("the viewer says where it is", lambda: "or in a browser: " in viewer.out)
    (address,) = re.findall(r"in a browser: http://127\.0\.0\.1:([0-9]+)", viewer.out)
    browser.load(f"http://localhost:{address}/")

    shown: list[Picture] = []

    def everything() -> bool:
        content = browser.shot()
        (tmp_path / "shot.png").write_bytes(content)
        shown.append(np.asarray(Image.open(io.BytesIO(content)).convert("RGB")))
        return not missing(shown[-1])

    wait_until("everything is on the screen", everything, PATIENCE_S)
    first = shown[-1]
    assert len(np.unique(first.reshape(-1, 3), axis=0)) > 500

    def moves() -> bool:
        changed = share(first, *PLOTS) != share(shown[-1], *PLOTS)
        return everything() and changed.any(axis=2).mean() > 0.01

    wait_until("the curves move on", moves, PATIENCE_S)
    assert viewer.stop() == 0
    assert viewer.err == ""
