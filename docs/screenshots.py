"""What stands on a screen, of one made flight: the page of a run (`report.html`), and the viewer of `rsflow live`.

python docs/screenshots.py [FOLDER]     makes gallery/report.jpg and gallery/live.jpg anew, by the system's Chromium

The pictures are kept with the pages, which are built without a browser.
"""

from __future__ import annotations

import contextlib
import functools
import os
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import rsflow
from rsflow import synthetic

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
# The viewer draws by WebGL, which these do without a graphics card.
SOFTWARE = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--use-gl=angle", "--ignore-gpu-blocklist")
KNOWN = {"height_m": 0.5, "height_std_m": 0.002}
# How long the viewer may take to draw, in seconds.
PATIENCE_S = 90.0
# Seen so often it has come to the last frame, where it stays.
LOOKS = 4


def flown(frames: int) -> synthetic.Flight:
    """Make a flight along a bend, over ground on which a thing moves."""
    exact = dict.fromkeys(("fx", "fy", "cx", "cy"), 0.0)
    camera = rsflow.Camera(330.0, 330.0, 159.5, 119.5, width=320, height=240, std=exact)
    thing = synthetic.MovingObject(center_m=(0.1, -0.1), size_m=(0.12, 0.09), velocity_m_s=(-0.1, 0.12))
    turn = np.linspace(0.0, 2.0, frames - 1)
    velocity_m_s = np.stack([0.15 * np.cos(turn), 0.1 * np.sin(turn), 0.0 * turn], axis=1)
    return synthetic.flight_with_object(
        camera, objects=[thing], frames=frames, height_m=KNOWN["height_m"], velocity_m_s=velocity_m_s, seed=3
    )


@contextlib.contextmanager
def opened(program: str) -> Iterator[Any]:
    """Open a browser without a window."""
    from playwright.sync_api import sync_playwright

    # Its sandbox refuses to run as root, as in a container.
    alone = ["--no-sandbox"] if getattr(os, "geteuid", lambda: 1)() == 0 else []
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=program, args=[*alone, *SOFTWARE])
        try:
            yield browser
        finally:
            browser.close()


@contextlib.contextmanager
def served(folder: Path) -> Iterator[str]:
    """Serve the files of a folder to pages of another address; give the address."""

    class Handler(SimpleHTTPRequestHandler):
        def end_headers(self) -> None:
            self.send_header("Access-Control-Allow-Origin", "*")
            super().end_headers()

        def log_message(self, *_: Any) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Handler, directory=folder))
    threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()


def picture_of(page: Any) -> np.ndarray[Any, Any]:
    """Give what a page shows, in blue, green, red."""
    return cv2.imdecode(np.frombuffer(page.screenshot(timeout=100_000), np.uint8), cv2.IMREAD_COLOR)


def report(browser: Any, flight: synthetic.Flight, folder: Path) -> np.ndarray[Any, Any]:
    """Give the first screen of a run's page."""
    with rsflow.VideoWriter(folder / "flight.mp4", frame_rate=30) as video:
        for image in flight.images:
            video.write(image)
    done = rsflow.extract(folder / "flight.mp4", folder / "out", camera=flight.camera, **KNOWN)
    page = browser.new_page(viewport={"width": 1200, "height": 1000})
    page.goto(Path(done.files["report"]).resolve().as_uri())
    page.wait_for_load_state("networkidle")
    return picture_of(page)


def live(browser: Any, flight: synthetic.Flight, folder: Path, port: int = 9876) -> np.ndarray[Any, Any]:
    """Give the viewer over a recording of a live run."""
    import rerun

    path = folder / "run.rrd"
    rsflow.live.watch(flight, record=path, camera=flight.camera, camera_motion="moving", **KNOWN)
    with served(folder) as address:
        rerun.serve_web_viewer(web_port=port, open_browser=False)
        page = browser.new_page(viewport={"width": 1200, "height": 750})
        page.goto(f"http://127.0.0.1:{port}/?url={address}/{path.name}")
        page.wait_for_selector("canvas")
        end, drawn = time.monotonic() + PATIENCE_S, 0
        while drawn < LOOKS:
            if time.monotonic() > end:
                raise TimeoutError(f"the viewer has drawn no frame within {PATIENCE_S:g} s")
            time.sleep(1.0)
            picture = picture_of(page)
            # The frame is grey, the page around it white.
            grey = (np.ptp(picture, axis=2) < 3) & (picture[..., 0] > 60) & (picture[..., 0] < 200)
            drawn += int(grey.mean() > 0.1)
        return picture


def main(folder: Path, frames: int = 40) -> int:
    """Write both pictures; 1 where no browser is found, and what is there is kept."""
    program = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if program is None:
        print(f"no browser, expected one of {', '.join(BROWSERS)} on the path: the pictures are kept", file=sys.stderr)
        return 1
    flight = flown(frames)
    with opened(program) as browser:
        for name, draw in (("report", report), ("live", live)):
            with tempfile.TemporaryDirectory() as place:
                picture = draw(browser, flight, Path(place))
            cv2.imwrite(str(folder / f"{name}.jpg"), picture, [cv2.IMWRITE_JPEG_QUALITY, 85])
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parent / "gallery"))
