from __future__ import annotations

import shutil
import signal

import numpy as np
import pytest

from safe_inspect.errors import OutputError, SafeInspectError
from safe_inspect.figures import pictures
from safe_inspect.figures.film import Film, moment
from safe_inspect.figures.pictures import save_film
from safe_inspect.geometry.picture import Camera


@pytest.fixture(scope="module")
def film(flown):
    return Film(flown, frames=6, width=480)


def test_a_gif_has_every_picture_and_is_small(film, tmp_path):
    from PIL import Image

    told = []
    save_film(film, tmp_path / "new" / "a.gif", fps=20, progress=lambda done, wanted: told.append((done, wanted)))
    with Image.open(tmp_path / "new" / "a.gif") as image:
        assert image.n_frames == 6
        assert image.size == (480, 300)
        assert image.info["duration"] == 50
        assert image.convert("RGB").getpixel((5, 290)) == (255, 255, 255)
        image.seek(3)
        difference = np.asarray(image.convert("RGB"), dtype=int) - film.picture(3)
    assert np.abs(difference).mean() < 3.0  # the palette is coarse
    assert (tmp_path / "new" / "a.gif").stat().st_size < 100_000
    assert told == [(done, 6) for done in range(1, 7)]


def test_the_pictures_differ_and_are_the_same_again(film):
    first, last = film.picture(0), film.picture(5)
    assert first.shape == (300, 480, 3)
    assert (first != last).any()
    np.testing.assert_array_equal(film.picture(0), first)


def test_several_deputies_and_a_turning_camera_are_filmed(flown_team, tmp_path):
    save_film(Film(flown_team, frames=3, width=400, turn=60.0), tmp_path / "team.gif")
    assert (tmp_path / "team.gif").read_bytes().startswith(b"GIF89a")


def test_between_two_states_a_deputy_follows_the_cubic_through_both(flown):
    for row in (0, 7, len(flown.time) - 2):
        here, there = moment(flown, flown.time[row]), moment(flown, flown.time[row + 1])
        np.testing.assert_allclose(here.position, flown.position[row])
        np.testing.assert_allclose(there.position, flown.position[row + 1])
        small = 1e-3
        slope = (moment(flown, flown.time[row] + small).position - here.position) / small
        np.testing.assert_allclose(slope, flown.velocity[row], atol=1e-3)
    assert int(moment(flown, flown.time[-1]).seen.sum()) == int(np.isfinite(flown.inspected_at).sum())


def test_a_moment_knows_what_was_seen_by_then(flown):
    for row in (0, 5, 20):
        now = moment(flown, float(flown.time[row]))
        assert now.seen.mean() == pytest.approx(flown.coverage[row])
        np.testing.assert_array_equal(now.lit, flown.points @ flown.sun_direction[row] > 0.0)


def area(outline):
    x, y = outline.T
    return abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1))) / 2.0


def test_the_day_side_has_the_area_of_a_phase():
    camera = Camera.at(22.0, -52.0)
    for angle in np.linspace(0.0, 6.0, 13):
        sun = np.array([np.cos(angle), -np.sin(angle), 0.0])
        share = (1.0 + float(sun @ camera.sight)) / 2.0  # the phase of a moon
        assert area(camera.day(sun, 10.0, corners=400)) == pytest.approx(np.pi * 100.0 * share, rel=1e-3)


def test_the_chief_hides_what_is_behind_it():
    camera = Camera.at(0.0, 0.0)  # on the radial axis
    points = np.array([[-50.0, 0.0, 0.0], [50.0, 0.0, 0.0], [-50.0, 11.0, 0.0], [-50.0, 9.0, 0.0]])
    assert camera.hidden(points, 10.0).tolist() == [True, False, False, True]
    np.testing.assert_allclose(camera.flat(np.array([0.0, 3.0, 4.0])), [3.0, 4.0])


def test_a_film_that_cannot_be_written_is_one_message(film, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="the file cannot be written"):
        save_film(film, tmp_path / "file" / "a.gif")
    with pytest.raises(OutputError, match=r"must end in \.gif or \.mp4"):
        save_film(film, tmp_path / "a.avi")


def test_without_ffmpeg_the_message_says_what_to_install(film, tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    with pytest.raises(SafeInspectError, match=r"pip install 'safe_inspect\[film\]'"):
        save_film(film, tmp_path / "a.mp4")
    assert not (tmp_path / "a.mp4").exists()


def test_the_pictures_go_to_ffmpeg_one_by_one(film, tmp_path, monkeypatch):
    program = tmp_path / "ffmpeg"
    program.write_text('#!/bin/sh\nfor last; do :; done\nexec cat > "$last"\n')
    program.chmod(0o755)
    monkeypatch.setattr(pictures, "find_ffmpeg", lambda: str(program))
    save_film(film, tmp_path / "a.mp4")
    raw = np.frombuffer((tmp_path / "a.mp4").read_bytes(), dtype=np.uint8).reshape(6, 300, 480, 3)
    np.testing.assert_array_equal(raw[4], film.picture(4))


def test_what_ffmpeg_says_is_reported(film, tmp_path, monkeypatch):
    program = tmp_path / "ffmpeg"
    program.write_text("#!/bin/sh\necho no such codec >&2\nexit 3\n")
    program.chmod(0o755)
    monkeypatch.setattr(pictures, "find_ffmpeg", lambda: str(program))
    with pytest.raises(OutputError, match="ffmpeg says: no such codec"):
        save_film(film, tmp_path / "a.mp4")


def test_a_film_that_is_stopped_ends_ffmpeg_and_leaves_the_former_one(film, tmp_path, monkeypatch):
    program = tmp_path / "ffmpeg"
    program.write_text('#!/bin/sh\nfor last; do :; done\nexec cat > "$last"\n')
    program.chmod(0o755)
    monkeypatch.setattr(pictures, "find_ffmpeg", lambda: str(program))
    (tmp_path / "a.mp4").write_text("old")

    def stop(done, wanted):
        if done == 2:
            raise KeyboardInterrupt

    def late(number, frame):
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(20)
    try:
        with pytest.raises(KeyboardInterrupt):
            save_film(film, tmp_path / "a.mp4", progress=stop)
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
    assert (tmp_path / "a.mp4").read_text() == "old"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mp4", "ffmpeg"]


def test_a_full_disk_is_reported_once(film, tmp_path, monkeypatch):
    program = tmp_path / "ffmpeg"
    program.write_text(
        "#!/bin/sh\necho av_interleaved_write_frame: No space left on device >&2\necho failed >&2\nexit 1\n"
    )
    program.chmod(0o755)
    monkeypatch.setattr(pictures, "find_ffmpeg", lambda: str(program))
    with pytest.raises(OutputError) as caught:
        save_film(film, tmp_path / "a.mp4")
    reason = "the file cannot be written (No space left on device); free some space, or give another file"
    assert str(caught.value) == f"{tmp_path / 'a.mp4'}: {reason}"


def test_numbers_out_of_range_are_refused(flown, film, tmp_path):
    with pytest.raises(ValueError, match="at least 2 frames"):
        Film(flown, frames=1)
    with pytest.raises(ValueError, match="a width of 320 to 3840 pixels"):
        Film(flown, width=10)
    with pytest.raises(ValueError, match="pictures per second"):
        save_film(film, tmp_path / "a.gif", fps=0.0)
