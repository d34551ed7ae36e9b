"""Pages of the viewer in a headless Chromium, driven by Playwright; what they log and ask for is kept."""

import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

PATHS = ("chromium", "chromium-browser", "google-chrome")
WINDOW = {"width": 900, "height": 520}
IN_SOFTWARE = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
"""WebGL without a graphics card."""
EXPECTED = (
    "THREE.Clock",  # viser's own library calls what is deprecated in it
    "GPU stall",  # of a screenshot, where WebGL is software
)
"""Warnings that are no fault of what is shown."""


@contextmanager
def chromium() -> Iterator[Any]:
    """A browser; skips, with the reason, where there is no Chromium or no Playwright."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    path = next((found for one in PATHS if (found := shutil.which(one))), None)
    if path is None:
        pytest.skip(f"there is no Chromium: none of {', '.join(PATHS)}")
    with sync_api.sync_playwright() as playwright:
        # The tests of a container run as root, where Chromium has no sandbox.
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox", *IN_SOFTWARE])
        yield browser
        browser.close()


class Page:
    """A window in which one address of the viewer is open."""

    def __init__(self, browser: Any, address: str) -> None:
        self.bad: list[str] = []
        """Warnings and errors of the console, and requests that failed."""
        self.asked: set[str] = set()
        """Addresses that it asked for something, without what they were asked for."""
        self.page = browser.new_page(viewport=WINDOW)
        self.page.on("console", self._logged)
        self.page.on("pageerror", lambda error: self.bad.append(str(error)))
        self.page.on("requestfailed", lambda request: self.bad.append(f"{request.url}: {request.failure}"))
        self.page.on("request", lambda request: self.asked.add("/".join(request.url.split("/")[:3])))
        self.page.on("websocket", lambda socket: self.asked.add("/".join(socket.url.split("/")[:3])))
        self.page.goto(address)
        self.text("Fly along").wait_for()

    def _logged(self, message: Any) -> None:
        if message.type in {"warning", "error"} and not any(one in message.text for one in EXPECTED):
            self.bad.append(f"{message.type}: {message.text}")

    def text(self, words: str) -> Any:
        """The first thing on the page with these words in it."""
        return self.page.get_by_text(words).first

    def number(self, label: str, value: float) -> None:
        """Types a value beside a slider."""
        box = self._row(label).locator("input:not([type=hidden])").last
        box.fill(str(value))
        box.press("Enter")

    def choose(self, label: str, value: str) -> None:
        """Takes an entry of a list, again where it closes while its folder still moves."""
        box = self._row(label).locator("input[role=combobox]")
        for _ in range(10):
            box.click()
            option = self.page.get_by_role("option", name=value, exact=True)
            self.page.wait_for_timeout(300)
            if option.is_visible():
                option.click()
                return
        raise AssertionError(f"the list of {label} does not stay open")

    def press(self, name: str) -> None:
        """A button of the panel."""
        self.page.get_by_role("button", name=name, exact=True).click()

    def unfold(self, name: str) -> None:
        """A folder of the panel."""
        self.page.locator(".mantine-Paper-root").get_by_text(name, exact=True).click()

    def _row(self, label: str) -> Any:
        """The label of a control and what lies beside it."""
        exact = re.compile(f"^{re.escape(label)}$")
        return self.page.locator("label").filter(has_text=exact).locator("xpath=ancestor::div[2]")
