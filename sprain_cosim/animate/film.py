"""The landing in slow motion, from behind and from the side, with ground force, moments and curves running along. Needs
no OpenGL."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from ..errors import EnvironmentProblem, InputError
from ..files import whole_file
from ..folders.landing import Landing
from .stage import Stage

RATE = 25  # pictures per second
HOLD = 1.2  # s on the last picture
QUALITY = 78
FORMATS = (".webp", ".mp4", ".gif", ".png")


def animate(
    runs: Sequence[Landing], out: Path, slow: float = 20.0, progress: Callable[[float], None] | None = None
) -> int:
    """Writes the landings side by side, slowed `slow` times, to `out` (.webp, .mp4, .gif; .png: the instant of the
    largest subtalar angle). Returns the number of pictures. Raises InputError, EnvironmentProblem."""
    kind = out.suffix.lower()
    if kind not in FORMATS:
        raise InputError(f"{out}: ends in {kind or 'nothing'}; an animation ends in {', '.join(FORMATS)}")
    if not 1.0 <= slow <= 1000.0:
        raise InputError(f"slowed {slow:g} times: must lie between 1 and 1000")
    ends = max(float(run.result.time[-1]) for run in runs)
    times = np.arange(int(ends * RATE * slow + 1e-9) + 1) / (RATE * slow)
    if kind == ".png":
        first = runs[0].result
        times = first.time[[int(np.argmax(first["plant.subtalar_angle"]))]]
    stage = Stage(runs, slow)

    def counted() -> Iterator[np.ndarray]:
        for k, frame in enumerate(stage.frames(times)):
            yield frame
            if progress:
                progress((k + 1) / len(times))

    with whole_file(out, parents=True) as partial:
        (_video if kind == ".mp4" else _pictures)(counted(), len(times), partial)
    return len(times)


def _pictures(frames: Iterator[np.ndarray], count: int, out: Path) -> None:
    from PIL import Image

    first, rest = Image.fromarray(next(frames)), (Image.fromarray(frame) for frame in frames)
    if count == 1:
        first.save(out)
        return
    milliseconds = [round(1e3 / RATE)] * (count - 1) + [round(1e3 * HOLD)]
    more = (
        {"quality": QUALITY, "method": 4, "minimize_size": False}
        if out.suffix.lower() == ".webp"
        else {"optimize": False}
    )
    first.save(out, save_all=True, append_images=rest, duration=milliseconds, loop=0, **more)


def _video(frames: Iterator[np.ndarray], count: int, out: Path) -> None:
    try:
        import imageio_ffmpeg
    except ImportError:
        raise EnvironmentProblem(
            'MP4 needs the extra [video]: pip install "sprain-cosim[video]"; .webp needs nothing'
        ) from None
    first = next(frames)
    writer = imageio_ffmpeg.write_frames(
        str(out),
        first.shape[1::-1],
        fps=RATE,
        codec="libx264",
        quality=None,
        output_params=["-crf", "20"],
        macro_block_size=2,
    )
    writer.send(None)
    try:
        writer.send(np.ascontiguousarray(first))
        last = first
        for frame in frames:
            last = frame
            writer.send(np.ascontiguousarray(frame))
        for _ in range(round(HOLD * RATE)):
            writer.send(np.ascontiguousarray(last))
    finally:
        writer.close()
