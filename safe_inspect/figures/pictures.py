"""`Pictures`: base class of the films, and their files: GIF by Pillow, MP4 by ffmpeg."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from safe_inspect.errors import OutputError, SafeInspectError
from safe_inspect.evaluation.episodes import Progress
from safe_inspect.figures.drawing import new_figure, style
from safe_inspect.outputs import new_file
from safe_inspect.types import AnyArray


class Pictures(ABC):
    """Base class of a sequence of pictures that are equally spaced in time.

    A subclass sets the attributes that `_build` needs, and then calls ``super().__init__``.

    Args:
        frames: Number of pictures, at least 2.
        width: Width of a picture [pixels]; it is 1.6 times its height.

    Raises:
        SafeInspectError: Matplotlib is not installed.
        ValueError: A number is out of range.

    Attributes:
        frames: Number of pictures.
        size: Width and height of a picture [pixels].
    """

    def __init__(self, frames: int, width: int) -> None:
        if frames < 2 or not 320 <= width <= 3840:
            raise ValueError(f"expected at least 2 frames and a width of 320 to 3840 pixels, got {frames} and {width}")
        self.frames = frames
        self.size = (2 * (width // 2), 2 * round(width / 3.2))  # video codecs require even numbers
        # The resolution grows with the width, so that fonts and lines keep their relative sizes.
        with new_figure(8.0, 8.0 * self.size[1] / self.size[0], dpi=self.size[0] / 8.0) as figure:
            from matplotlib.backends.backend_agg import FigureCanvasAgg

            self._canvas: Any = FigureCanvasAgg(figure)
            self._build(figure)

    @abstractmethod
    def _build(self, figure: Any) -> None:
        """Draw everything that all pictures have in common, and make what `_show` updates."""

    @abstractmethod
    def _show(self, share: float) -> None:
        """Update the figure to a share of the film's time, from 0 to 1."""

    def __len__(self) -> int:
        return self.frames

    def __iter__(self) -> Iterator[AnyArray]:
        """Yield the pictures in red, green and blue, uint8, shape (height, width, 3)."""
        for index in range(self.frames):
            yield self.picture(index)

    def picture(self, index: int) -> AnyArray:
        """Return a picture by its index from 0, in red, green and blue, uint8, shape (height, width, 3)."""
        with style():
            self._show(index / (self.frames - 1))
            self._canvas.draw()
            return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()


_COLOURS = 96


def save_film(
    film: Pictures, path: str | os.PathLike[str], fps: float = 25.0, progress: Progress | None = None
) -> None:
    """Write a film; the ending of the file's name determines the format (gif, mp4).

    Args:
        film: The film.
        path: The file.
        fps: Pictures per second.
        progress: Called after each picture with (drawn pictures, their number).

    Raises:
        OutputError: The file cannot be written, or the format is unknown.
        SafeInspectError: The program or package that writes the format is not installed.
        ValueError: `fps` is out of range.
    """
    target = Path(path)
    writers = {".gif": _write_gif, ".mp4": _write_mp4}
    if target.suffix.lower() not in writers:
        raise OutputError(f"cannot write the film {os.fspath(path)!r}: its name must end in .gif or .mp4")
    if not 1.0 <= fps <= 100.0:
        raise ValueError(f"a film must have 1 to 100 pictures per second, got {fps:g}")
    with new_file(path) as work:
        work.touch()  # raises an error, if any, before the pictures are drawn
        writers[target.suffix.lower()](_with_progress(film, progress), film.size, work, fps)


def _with_progress(film: Pictures, progress: Progress | None) -> Iterable[AnyArray]:
    for index, picture in enumerate(film):
        yield picture
        if progress is not None:
            progress(index + 1, len(film))


def _write_gif(pictures: Iterable[AnyArray], size: tuple[int, int], path: Path, fps: float) -> None:
    """Write a GIF with one palette for all pictures, so that static parts take no space."""
    from PIL import Image

    images = [Image.fromarray(picture) for picture in pictures]
    sample = [images[round(share * (len(images) - 1))] for share in (0.0, 0.33, 0.67, 1.0)]
    montage = Image.fromarray(np.concatenate([np.asarray(image) for image in sample], axis=0))
    palette = montage.quantize(_COLOURS, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    _whiten(palette)
    frames = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    durations = [max(round(100.0 / fps) * 10, 10)] * len(frames)
    durations[-1] += 2000  # pause at the end
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=durations, loop=0, optimize=True, disposal=1)


def _whiten(image: Any) -> None:
    """Make the lightest colours of a palette white, as Pillow replaces white by one of them, not by the nearest."""
    colours = np.asarray(image.getpalette(), dtype=np.int64).reshape(-1, 3)
    colours[colours.min(axis=1) >= 246] = 255
    image.putpalette(colours.reshape(-1).tolist())


def find_ffmpeg() -> str:
    """Return the ffmpeg of this machine, or that of the package imageio-ffmpeg.

    Raises:
        SafeInspectError: Neither is installed.
    """
    found = shutil.which("ffmpeg")
    if found:
        return found
    try:
        import imageio_ffmpeg  # type: ignore[import-untyped]

        return str(imageio_ffmpeg.get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        raise SafeInspectError(
            "MP4 films need ffmpeg; install it with: pip install 'safe_inspect[film]', or write a .gif"
        ) from None


def _write_mp4(pictures: Iterable[AnyArray], size: tuple[int, int], path: Path, fps: float) -> None:
    command: list[Any] = [
        find_ffmpeg(), "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{size[0]}x{size[1]}",
        "-r", f"{fps:g}", "-i", "-", "-an", "-c:v", "libx264", "-preset", "slow", "-crf", "20", "-pix_fmt", "yuv420p",
        "-movflags", "+faststart", str(path),
    ]  # fmt: skip
    with tempfile.TemporaryFile() as messages:  # a pipe could fill up and block ffmpeg
        # A separate session, so that Ctrl-C in the terminal only reaches this process, which then ends ffmpeg.
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=messages, start_new_session=True)
        assert process.stdin is not None
        try:
            with suppress(BrokenPipeError):  # ffmpeg has ended; its messages are reported below
                for picture in pictures:
                    process.stdin.write(np.ascontiguousarray(picture).tobytes())
        except BaseException:
            process.kill()
            raise
        finally:
            with suppress(BrokenPipeError):
                process.stdin.close()
            code = process.wait()
        messages.seek(0)
        reason = messages.read().decode(errors="replace").strip().splitlines()
    if any(os.strerror(errno.ENOSPC) in line for line in reason):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    if code:
        raise OutputError(f"the film cannot be written; ffmpeg says: {reason[-1] if reason else code}")
