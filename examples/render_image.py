"""One picture of an avatar, its head turned to the side.

python examples/render_image.py --avatar runs/ann/avatar --out ann.png
"""

from pathlib import Path

import tyro
from PIL import Image
from scipy.spatial.transform import Rotation

from dynhair import Avatar


def main(avatar: Path, out: Path, degrees: float = 20.0) -> None:
    person = Avatar.load(avatar)
    assert person.recording is not None, "an avatar from before recordings were kept: train it again"
    rest = person.recording.rest
    turn = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
    image = person.render((turn @ rest.rotation.numpy(), rest.translation))  # (h, w, 3), sRGB in [0, 1]
    Image.fromarray((255 * image).round().byte().numpy()).save(out)


if __name__ == "__main__":
    tyro.cli(main)
