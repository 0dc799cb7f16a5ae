"""The documentation site builds without a warning: links, anchors, docstrings, pages that no menu shows."""

from __future__ import annotations

import html
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

_ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the site."""
    pytest.importorskip("mkdocs", reason="pip install 'safe_inspect[docs]'")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=_ROOT, env=environment, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.mark.slow
def test_the_site_builds_and_holds_the_pages_of_other_folders(site: Path) -> None:
    for page, told in {
        "index.html": "Safe reinforcement learning of spacecraft inspection",
        "changelog.html": "Keep a Changelog",
        "tutorials/own-reward.html": "BandReward",
        "examples/plugin_package/index.html": "safe-inspect-example",
        "examples/learners/index.html": "cleanrl_ppo.py",
        "gallery.html": "images/episode.gif",
        "experiments/three-deputies.html": "three",
    }.items():
        assert told in (site / page).read_text(encoding="utf-8"), page
    assert (site / "images" / "episode.gif").stat().st_size > 100_000
    start = (site / "index.html").read_text(encoding="utf-8")
    assert 'href="safety.html"' in start
    assert 'src="images/trajectory.png"' in start
    assert '<script src="http' not in start  # nothing is loaded from the network, the search neither
    assert (site / "javascripts" / "iframe-worker.js").exists()
    assert "fonts.googleapis.com" not in start


@pytest.mark.slow
def test_the_reference_shows_fields_with_their_defaults_and_what_docstrings_say(site: Path) -> None:
    page = (site / "reference" / "safe_inspect.rewards.html").read_text(encoding="utf-8")
    text = page.partition('id="safe_inspect.rewards.inspection.ObservedPointsReward"')[2].partition(
        'id="safe_inspect.'
    )[0]
    words = " ".join(html.unescape(re.sub(r"<[^>]*>", " ", text)).split())
    assert re.search(r"scale ?: float = 0.01", words), words
    assert "Pay scale for every point that the team first inspects in this step" in words
    assert "Reward for one point" in words
