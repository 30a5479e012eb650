"""The viewer in a browser without a display: pages open, controls act, nothing is reported.

Needs `playwright` and Chromium, which Debian has: apt-get install chromium.
"""

import os
import re
import shutil
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
FLAGS += ("--ignore-gpu-blocklist", "--disable-background-networking")
TIMEOUT = 60_000  # [ms]

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium: apt-get install chromium"),
]


@contextmanager
def serve(*words):
    """Run `dgl view` and give its address."""
    command = [Path(sys.executable).with_name("dgl"), "view", *words, "--port", "18200"]
    environment = os.environ | {"PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(command, env=environment, stdout=-1, stderr=-2, text=True) as server:
        try:
            for line in server.stdout:
                if found := re.search(r"http://127\.0\.0\.1:\d+", line):
                    yield found[0]
                    return
            pytest.fail("dgl view told no address")
        finally:
            server.terminate()


@pytest.fixture
def open_page():
    """A function that opens an address; at the end no page may have reported an error."""
    playwright = pytest.importorskip("playwright.sync_api")
    errors = []
    with playwright.sync_playwright() as tools:
        browser = tools.chromium.launch(executable_path=CHROMIUM, args=FLAGS)

        def open_page(url):
            page = browser.new_page(viewport={"width": 1100, "height": 700})
            page.set_default_timeout(TIMEOUT)
            page.on("console", lambda m: errors.append(m.text) if m.type == "error" else None)
            page.on("pageerror", lambda error: errors.append(str(error)))
            page.goto(url)
            page.wait_for_selector("canvas")
            return page

        yield open_page
        browser.close()
    assert errors == []


def test_a_click_on_a_garment_is_found_on_the_other(open_page):
    with serve("garment", "Trousers/000001", "Trousers/000002") as url:
        page = open_page(url)
        box = page.query_selector("canvas").bounding_box()
        places = [(0.1 * i, 0.1 * j) for j in (5, 4, 6, 7) for i in (2, 3, 4)]
        for x, y in places:
            page.mouse.click(box["x"] + x * box["width"], box["y"] + y * box["height"])
            page.wait_for_timeout(1500)
            if "exact correspondence" in page.inner_text("body"):
                return
        pytest.fail("no click picked a point")


def test_a_task_runs_pauses_steps_and_is_reset(open_page):
    with serve("task", "HangTops-v1", "--seed", "3") as url:
        page = open_page(url)
        page.get_by_text("reset: Tops").wait_for()
        page.get_by_role("button", name="run").click()
        page.get_by_text("stage hang").wait_for()
        page.get_by_role("button", name="pause").click()
        page.get_by_role("button", name="step").click()
        page.get_by_role("button", name="reset").click()
        page.get_by_text("reset: Tops").wait_for()
