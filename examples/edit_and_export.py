"""Hair cut to the chin and dyed, then the nodding avatar as splats, strands and a motion file for other programs.

python examples/edit_and_export.py --avatar runs/ann/avatar --out ann_short
"""

from pathlib import Path

import tyro

from dynhair import Avatar
from dynhair.editing import Tint, Trim
from dynhair.export.run import run_export


def main(avatar: Path, out: Path) -> None:
    short = Avatar.load(avatar).edited(Trim(longest=0.12), Tint("#5a1f24", strength=0.7))
    short.save(out / "avatar")  # edits are kept beside the trained hair, and can be taken back
    run_export(out / "avatar", out, ["ply", "npz", "motion"], motion="nod", frames="0:5")


if __name__ == "__main__":
    tyro.cli(main)
