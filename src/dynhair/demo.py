"""The demo: the whole path on the bundled capture, in minutes."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from dynhair.errors import DynhairError
from dynhair.evaluation import Appearance, run_evaluation
from dynhair.presets import preset
from dynhair.training.trainer import train


def sample_capture() -> Path:
    """The folder of the bundled capture, in an installed package or in a checkout.

    Raises:
        DynhairError: it is in neither.
    """
    package = Path(__file__).parent
    places = (package / "sample_capture", package.parents[1] / "data" / "sample_capture")
    for place in places:
        if (place / "capture.json").exists():
            return place
    raise DynhairError(
        "the bundled capture is missing", path=places[-1], mend="install dynhair again, or clone its repository"
    )


def run_demo(out: Path) -> None:
    """Train preset ``tiny`` on the bundled capture and evaluate it, which says where the pictures are.

    An interrupted demo goes on where it was.

    Args:
        out: folder for the run and its evaluation.
    """
    console = Console()
    capture = sample_capture()
    if not (out / "avatar" / "avatar.json").exists():
        train(capture, out, preset("tiny"), resume=(out / "run.json").exists(), console=console)
    run_evaluation(out / "avatar", capture, out / "evaluation", appearance=Appearance.quick(), console=console)
