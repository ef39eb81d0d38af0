"""Videos that browsers play: H.264 in MP4, 4:2:0, index first."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.video.reformatter import ColorRange, Colorspace

from dynhair.pictures import Picture
from dynhair.storage import atomic_file

QUALITY = "18"
"""x264's constant rate factor: 18 looks like the original."""

BT709 = 1
"""As H.264 numbers it, for primaries and transfer."""


@contextmanager
def video_writer(path: Path | str, fps: float) -> Iterator[Callable[[Picture], None]]:
    """Yield what appends a frame, of the size of the first, to a video.

    The file appears when the last frame is in, and not at all on an error. An odd width or height is made
    even, as 4:2:0 needs, by repeating the last column or row. Colours are BT.709, and say so.

    Args:
        path: ends in ``.mp4``.
        fps: frames per second.
    """
    with atomic_file(path) as temporary, av.open(str(temporary), "w", options={"movflags": "+faststart"}) as container:
        stream = container.add_stream("libx264", rate=Fraction(fps).limit_denominator(1001))
        stream.pix_fmt = "yuv420p"
        stream.codec_context.colorspace = Colorspace.ITU709
        stream.codec_context.color_range = ColorRange.MPEG
        stream.codec_context.color_primaries = stream.codec_context.color_trc = BT709
        stream.options = {"crf": QUALITY, "preset": "medium"}

        def append(frame: Picture) -> None:
            height, width = frame.shape[:2]
            even = np.pad(frame, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
            if not stream.codec_context.is_open:
                stream.height, stream.width = even.shape[:2]
            picture = av.VideoFrame.from_ndarray(even, format="rgb24")
            container.mux(stream.encode(picture.reformat(format="yuv420p", dst_colorspace=Colorspace.ITU709)))

        yield append
        container.mux(stream.encode())
