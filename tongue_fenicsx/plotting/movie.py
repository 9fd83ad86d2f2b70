# SPDX-License-Identifier: MIT
"""Movies of a run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from numpy.typing import NDArray
from PIL import Image

from ..analysis.moments import check_moment
from ..core.errors import InputError
from ..core.files import at_once
from ..runs.run import Run
from .scene import VIEWS, Places, stage

SHORT = {"hencky": "hencky_von_mises", "J": "jacobian"}
"""Other names of fields."""

Frames = Iterator[NDArray[np.uint8]]


def draw_movie(
    run: Run,
    path: str | Path,
    *,
    quantity: str = "displacement",
    view: str | None = "oblique",
    start: float | None = None,
    end: float | None = None,
    seconds: float = 4.0,
    fps: int = 25,
    beside: Places | None = None,
    report: Callable[[int, int], None] = lambda frame, frames: None,
) -> Path:
    """Draw the motion of a run as a movie of 1280 × 720 pixels, and return its file.

    Between two outputs of the run everything moves in proportion, so a run with few of them moves smoothly, too.

    Parameters
    ----------
    run : Run
        In a folder or in memory.
    path : path
        A file named .mp4 (H.264) or .gif.
    quantity : str
        A stored field, ``hencky`` or ``J``; of vectors the length is shown, of tensors the von Mises measure.
    view : str or None
        ``side``, ``front``, ``top`` or ``oblique``; None is the mid-sagittal section.
    start, end : float, optional
        Times in s of the run; by default its first and last output.
    seconds : float
        How long the movie takes.
    fps : int
        Frames per second.
    beside : mapping, optional
        Name to times (n,) in s and places (n, 3) in m of points, such as sensors, that the section shows beside the probes of their names.
    report : callable
        Gets the number of each frame that is drawn and how many there are.

    Raises
    ------
    InputError
        If the suffix is another, the run has no such field or no fields at such a time, or MP4 cannot be written on this machine, or
        points are to stand beside a view in space.
    """
    path = Path(path)
    if path.suffix not in WRITERS:
        raise InputError(f"{path}: a movie named {' or '.join(WRITERS)} is expected.")
    if view is not None and view not in VIEWS:
        raise InputError(f"movie: --view {view!r} is not one of {', '.join(VIEWS)}.")
    if beside and view is not None:
        raise InputError("movie: points beside the tongue are drawn in its section; leave out the view.")
    field = SHORT.get(quantity, quantity)
    with run.reading("fields.h5"):
        run.field(field, 0)
        outputs = run.output_times
    first, last = (check_moment(run, t, "movie") for t in (outputs[0] if start is None else start, outputs[-1] if end is None else end))
    if not first < last:
        raise InputError(f"movie: --from {first:g} --to {last:g} s; a start before the end is expected.")
    times = np.linspace(first, last, max(round(seconds * fps), 2))
    seen = np.unique([first, *outputs[(outputs > first) & (outputs < last)], last])

    def frames() -> Frames:
        with stage(run, field, seen, view, beside) as (figure, show):
            canvas = FigureCanvasAgg(figure)
            for number, t in enumerate(times, start=1):
                show(float(t))
                canvas.draw()
                yield np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])
                report(number, len(times))

    with at_once(path) as partial:
        WRITERS[path.suffix](partial, frames(), fps)
    return path


def _write_mp4(path: Path, frames: Frames, fps: int) -> None:
    first = next(frames)
    size = first.shape[1], first.shape[0]
    try:
        imageio_ffmpeg.get_ffmpeg_exe()
    except RuntimeError as error:
        raise InputError("movie: there is no ffmpeg for MP4 on this machine; install it, or give a file named .gif.") from error
    options = {"codec": "libx264", "pix_fmt_out": "yuv420p", "quality": 8, "macro_block_size": 2}
    writer = imageio_ffmpeg.write_frames(str(path), size, fps=fps, **options, output_params=["-movflags", "+faststart"])
    writer.send(None)
    try:
        for frame in (first, *frames):
            writer.send(frame)
    finally:
        writer.close()


def _write_gif(path: Path, frames: Frames, fps: int) -> None:
    pictures = (Image.fromarray(frame).quantize(256, dither=Image.Dither.NONE) for frame in frames)
    next(pictures).save(path, "GIF", save_all=True, append_images=pictures, duration=1000 / fps, loop=0)


WRITERS = {".mp4": _write_mp4, ".gif": _write_gif}
"""Suffix to what writes frames into a file."""
