"""The page of an episode in a real browser, on phones and desks, light and dark; needs the extra `browser`."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from safe_inspect.cli.main import main

_TEAM = "safe_inspect/MultiagentTranslationalInspectionSeed-v0"
_SHOW = """
import sys
from PyQt6.QtCore import QTimer, QUrl
from PyQt6.QtWebEngineCore import QWebEnginePage
from PyQt6.QtWebEngineWidgets import QWebEngineView
from PyQt6.QtWidgets import QApplication

class Page(QWebEnginePage):
    def javaScriptConsoleMessage(self, level, message, line, source):
        print("console: " + message, flush=True)

application = QApplication(["page"])
view = QWebEngineView()
view.setPage(Page(view))
view.resize(int(sys.argv[2]), int(sys.argv[3]))
view.show()
LOOK = '''(() => {
  const box = (id) => document.getElementById(id).getBoundingClientRect();
  const key = box("key"), space = box("space");
  const marks = [...document.querySelectorAll("#key i")].map((mark) => mark.style.borderTopStyle);
  return JSON.stringify({
    title: document.title, inner: innerWidth, scroll: document.documentElement.scrollWidth,
    background: getComputedStyle(document.body).backgroundColor, keyTop: key.top, spaceBottom: space.bottom,
    spaceHeight: space.height, charts: [...document.querySelectorAll("#series canvas")].map((c) => c.clientHeight),
    dashed: marks.filter((style) => style === "dashed").length, counters: document.getElementById("counters").innerText,
  });
})()'''

def look():
    view.page().runJavaScript(LOOK, lambda found: (print("found: " + found, flush=True), application.quit()))

view.loadFinished.connect(lambda ok: QTimer.singleShot(500, look))
view.load(QUrl("file://" + sys.argv[1]))
QTimer.singleShot(60_000, application.quit)
application.exec()
"""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write the page of an episode of eight deputies."""
    pytest.importorskip("PyQt6.QtWebEngineWidgets", reason="pip install 'safe_inspect[browser]'")
    path = tmp_path_factory.mktemp("page") / "page.html"
    words = ["view", "random", "--cfg", _TEAM, "blue#_ctrl.count=8", "--until", "1000", "--output", str(path)]
    assert main(words) == 0
    return path


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [320, 390, 768, 1440])
def test_the_page_fits_the_screen(page: Path, width: int, scheme: str) -> None:
    flags = f"--no-sandbox --disable-gpu --blink-settings=preferredColorScheme={int(scheme == 'light')}"
    environment = {
        **os.environ, "QT_QPA_PLATFORM": "offscreen", "QT_QUICK_BACKEND": "software",
        "QTWEBENGINE_DISABLE_SANDBOX": "1", "QTWEBENGINE_CHROMIUM_FLAGS": flags,
    }  # fmt: skip
    command = [sys.executable, "-c", _SHOW, f"{page}#0.5", str(width), "800"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, env=environment, check=False)
    lines = done.stdout.splitlines()
    assert [line for line in lines if line.startswith("console: ")] == []
    (found,) = (json.loads(line.removeprefix("found: ")) for line in lines if line.startswith("found: "))
    assert found["scroll"] <= found["inner"] == width
    assert found["background"] == ("rgb(20, 23, 28)" if scheme == "dark" else "rgb(255, 255, 255)")
    assert found["spaceHeight"] >= 240
    assert min(found["charts"]) >= 80
    assert found["dashed"] == 3  # of eight deputies; five have a distinct colour
    assert "in all" in found["counters"]
    assert "of seed 0" in found["title"]
    if width < 760:
        assert found["keyTop"] >= found["spaceBottom"]  # it lies below the scene, not on it
