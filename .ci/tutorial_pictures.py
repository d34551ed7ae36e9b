"""Makes the pictures of docs/tutorial.md: `tutorial_pictures.py OUT LOG`, into docs/images.

    LOOK=1 python .ci/tutorial.py OUT | tee LOG && python .ci/tutorial_pictures.py OUT LOG

OUT is the folder in which the tutorial ran, LOG what it printed.  Pages and windows are those of a headless
Chromium; the picture of step 5 is of a training of a minute that it watches.
"""

import argparse
import html
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from tests.support.chromium import Page, chromium

from plnerf.view.opened import open_source
from plnerf.view.server import ViewServer

ROOT = Path(__file__).resolve().parent.parent
IMAGES = ROOT / "docs" / "images"
WINDOW = {"width": 1280, "height": 760}
WIDTH = 960
LINES = 26
"""Of a command's output at most."""
PROGRESS = re.compile(r"^[a-z]+: \d+( s$|%)")
TERMINAL = """<body style="margin:0"><pre style="margin:0;padding:14px;background:#1e2429;color:#e6e6e6;
font:14px/1.35 'DejaVu Sans Mono',monospace;width:WIDTHpx;box-sizing:border-box;white-space:pre-wrap"
>TEXT</pre>"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("log", type=Path)
    given = parser.parse_args()
    log = given.log.read_text(encoding="utf-8")
    os.chdir(given.out)  # windows show the paths that they are given
    photos = sorted(Path("flight/photos").glob("*.jpg"))
    kept("1-photos", row([Image.open(photos[round(k * (len(photos) - 1))]) for k in (0.05, 0.5, 0.85)]))
    (panel, *_) = sorted(Path("run/eval/panels").glob("*.png"))
    kept("6-eval", Image.open(panel))
    frames = [sorted(Path("run/renders/path", kind).glob("*.png")) for kind in ("rgb", "depth")]
    kept("7-pictures", row([Image.open(of[len(of) // 2]) for of in frames]))
    with chromium() as browser:
        for name, command in (
            ("2-doctor", "plnerf doctor flight/photos"), ("4-views", "plnerf doctor flight\n"),
            ("10-export", "plnerf export"), ("11-score", "plnerf score"),
        ):  # fmt: skip
            terminal(browser, name, printed(log, command))
        window(browser, "3-poses", Path("flight"), lambda page: None)
        training(browser, "5-training")
        report(browser, "8-report", Path("run/survey/report.html").resolve())
        window(browser, "9-view", Path("run"), beside_the_line)


def kept(name: str, picture: Image.Image) -> None:
    """Writes a picture, as wide as the page at most."""
    picture = picture.convert("RGB")
    if picture.width > WIDTH:
        height = round(picture.height * WIDTH / picture.width)
        picture = picture.resize((WIDTH, height), Image.Resampling.LANCZOS)
    path = IMAGES / f"tutorial-{name}.webp"
    picture.save(path, quality=72, method=6)
    print(f"{path.relative_to(ROOT)}: {path.stat().st_size / 1000:.0f} kB")


def row(pictures: list[Image.Image]) -> Image.Image:
    """Beside each other, of one height."""
    height = min(one.height for one in pictures)
    same = [one.convert("RGB").resize((round(one.width * height / one.height), height)) for one in pictures]
    return Image.fromarray(np.concatenate([np.asarray(one) for one in same], axis=1))


def printed(log: str, command: str) -> str:
    """What a command of the tutorial printed, with the command."""
    found = re.search(rf"^\$ ({re.escape(command)}.*?)^= ", log, re.MULTILINE | re.DOTALL)
    assert found is not None, f"{command} is not in the log"
    lines = [line for line in found[1].rstrip().splitlines() if not PROGRESS.match(line)]
    # Rows of a table are cut, other lines are broken by the browser.
    shown = [line[:117] + "…" if len(line) > 118 and line[0] == "|" else line for line in lines[:LINES]]
    return "$ " + "\n".join([*shown, *(["…"] if len(lines) > LINES else [])])


def terminal(browser: Any, name: str, text: str) -> None:
    page = browser.new_page(viewport={"width": 1040, "height": 400})
    page.set_content(TERMINAL.replace("WIDTH", "1040").replace("TEXT", html.escape(text)))
    shot(page.locator("pre"), name)
    page.close()


def report(browser: Any, name: str, path: Path) -> None:
    page = browser.new_page(viewport={"width": 1100, "height": 1000})
    page.goto(path.as_uri())
    page.wait_for_timeout(1000)
    shot(page, name)
    page.close()


def window(browser: Any, name: str, source: Path, go: Callable[[Page], None]) -> None:
    """The viewer, after a person has done something there."""
    server = ViewServer(open_source(source), port=0)
    page = opened(browser, server.address)
    go(page)
    page.page.wait_for_timeout(20_000)  # until the finest picture is there
    shot(page.page, name)
    page.page.close()
    server.stop()


def opened(browser: Any, address: str) -> Page:
    page = Page(browser, address)
    page.page.set_viewport_size(WINDOW)
    notes = page.page.locator(".mantine-Notification-closeButton")
    page.page.wait_for_timeout(1000)
    for k in reversed(range(notes.count())):  # that WebGL is software here
        notes.nth(k).click()
    return page


def beside_the_line(page: Page) -> None:
    page.number("along, %", 35)


def training(browser: Any, name: str) -> None:
    """A minute of a training."""
    command = "-u -m plnerf train flight -o watched --seconds 600 --view"
    running = subprocess.Popen([sys.executable, *command.split()], stdout=subprocess.PIPE, text=True)
    assert running.stdout is not None
    address = next(found[0] for line in running.stdout if (found := re.search(r"http://\S+", line)))
    page = opened(browser, address)
    page.page.wait_for_timeout(60_000)
    page.press("Pause")
    page.page.wait_for_timeout(8_000)
    shot(page.page, name)
    page.press("Stop and save")
    running.communicate()
    page.page.close()


def shot(page: Any, name: str) -> None:
    path = IMAGES / f"tutorial-{name}.png"
    page.screenshot(path=path)
    kept(name, Image.open(path))
    path.unlink()


if __name__ == "__main__":
    main()
