"""An avatar that nods, driven pose by pose as a head tracker or a game would, as a video.

python examples/drive_live.py --avatar runs/ann/avatar --out nod.mp4
"""

from pathlib import Path

import numpy as np
import tyro
from scipy.spatial.transform import Rotation

from dynhair import Avatar
from dynhair.video import video_writer


def main(avatar: Path, out: Path, seconds: float = 2.0) -> None:
    person = Avatar.load(avatar).frozen()  # for drawing alone, sooner
    assert person.recording is not None, "an avatar from before recordings were kept: train it again"
    rest, fps = person.recording.rest, person.recording.fps
    live = person.live(delay=0)
    with video_writer(out, fps) as append:
        for frame in range(round(seconds * fps)):
            nod = Rotation.from_euler("x", 15 * np.sin(2 * np.pi * frame / fps), degrees=True).as_matrix()
            posed = live.step(nod @ rest.rotation.numpy(), rest.translation)
            assert posed is not None  # without a delay, there is an answer to every pose
            image = person.draw(posed, [person.recording.camera]).rgb[0].clamp(0, 1)
            append((255 * image).round().byte().numpy())


if __name__ == "__main__":
    tyro.cli(main)
