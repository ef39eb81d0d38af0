"""Any trained head, whatever the method, from its folder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from dynhair.avatar.model_folder import DESCRIPTION
from dynhair.errors import DynhairError
from dynhair.storage import read_json
from dynhair.training.run import avatar_folder

if TYPE_CHECKING:
    import torch

    from dynhair.evaluation.protocol import DrivenHead

KINDS = ("dynhair avatar", "dynhair gha baseline", "dynhair ga baseline", "dynhair simulator baseline")
"""What a head's ``avatar.json`` may call it."""


def open_driven_head(path: Path | str, device: torch.device | str = "cpu") -> DrivenHead:
    """Open an avatar or a baseline, as the ``kind`` in its ``avatar.json`` says. Nothing in it is executed.

    Args:
        path: its folder, or that of the run that made it.
        device: where it is posed and rendered.

    Raises:
        DynhairError: there is none, it is of no known kind, or it is damaged.
    """
    path = avatar_folder(Path(path))
    if not path.is_dir():
        raise DynhairError("there is no such folder", path=path, expected="a folder with avatar.json")
    kind = read_json(path / DESCRIPTION).get("kind")
    if kind not in KINDS:
        raise DynhairError(
            f"kind {kind!r}",
            path=path / DESCRIPTION,
            expected=" or ".join(f"'{known}'" for known in KINDS),
            mend="open it with the release that wrote it",
        )
    return _opener(kind)(path, device)


def _opener(kind: str) -> Callable[[Path, torch.device | str], DrivenHead]:
    """What opens a folder of this kind; only that method's code is imported."""
    if kind == "dynhair gha baseline":
        from dynhair.baselines.gha import GaussianHeadAvatar

        return GaussianHeadAvatar.load
    if kind == "dynhair ga baseline":
        from dynhair.baselines.ga import BoundGaussians

        return BoundGaussians.load
    if kind == "dynhair simulator baseline":
        from dynhair.baselines.simulator import SimulatedAvatar

        return SimulatedAvatar.load
    from dynhair.avatar import Avatar

    return Avatar.load
