"""How close an avatar comes to motions that its training did not see.

python examples/measure.py --avatar runs/ann/avatar --capture captures/ann
"""

from pathlib import Path

import torch
import tyro

from dynhair import Avatar, Capture
from dynhair.evaluation import psnr


def main(avatar: Path, capture: Path) -> None:
    person, truth = Avatar.load(avatar).frozen(), Capture.open(capture)
    for segment in truth.segments:
        if segment.split == "test":
            track, decibels = truth.track(segment), []
            for index, frame in enumerate(segment.frames):
                cameras = [truth.camera(frame, name) for name in truth.camera_names]
                views = truth.views([(frame, name) for name in truth.camera_names])
                images = person.draw(person.pose(track, index), cameras)
                decibels += psnr(images.rgb.clamp(0, 1), torch.stack([view.rgb for view in views])).tolist()
            print(f"{segment.name}: PSNR {sum(decibels) / len(decibels):.1f} dB")


if __name__ == "__main__":
    tyro.cli(main)
