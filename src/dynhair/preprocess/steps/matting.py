"""The person's mask in every view."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from dynhair.assets import asset_path
from dynhair.capture.encoding import read_mask, read_rgb
from dynhair.errors import DynhairError
from dynhair.pictures import Picture
from dynhair.preprocess.jobs import Job
from dynhair.preprocess.matting import Matting, fast_matting, modnet_matting, plate_matting, quality_matting
from dynhair.preprocess.options import PreprocessOptions
from dynhair.preprocess.sheets import tinted
from dynhair.preprocess.steps.step import Step
from dynhair.preprocess.workspace import ViewId, Workspace

_NETWORKS = {"fast": "selfie-segmentation", "quality": "isnet"}


class MattingStep(Step[ViewId]):
    """Writes ``mask_*.png``.

    Args:
        workspace: with images.
        options: the method, and what it needs.

    Raises:
        DynhairError: what the method needs is not there.
    """

    name, title = "mask", "Matting"

    def __init__(self, workspace: Workspace, options: PreprocessOptions) -> None:
        super().__init__(workspace)
        self._options = options
        self._colour = options.backdrop or _backdrop(workspace)
        self.methods = {view: self._method(view) for view in workspace.views}

    def settings(self) -> Mapping[str, Any]:
        modnet, methods = self._options.modnet, set(self.methods.values())
        return {
            "methods": sorted(methods),
            "networks": [asset_path(asset).name for method, asset in _NETWORKS.items() if method in methods],
            "backdrop": None if self._colour is None else list(self._colour),
            "modnet": None if modnet is None else str(modnet.resolve()),
        }

    def jobs(self) -> Sequence[Job[ViewId]]:
        return [
            Job(view, (self.workspace.image_path(view), *self._extra(view)), (self._target(view),))
            for view in self.workspace.views
        ]

    def worker(self) -> Callable[[ViewId], None]:
        made: dict[str, Matting] = {}

        def work(view: ViewId) -> None:
            method = self.methods[view]
            if method == "given":
                coverage = read_mask(self.workspace.given_path(view, "mask"))
            else:
                key = f"{method} {view.name}" if method == "plate" else method
                if key not in made:
                    made[key] = self._matting(view)
                coverage = made[key](self.workspace.image(view))
            self.workspace.write_mask(view, "mask", coverage, raw=self._options.steady)

        return work

    def picture(self, view: ViewId) -> Picture:
        return tinted(self.workspace.image(view), self.workspace.mask(view), (64, 220, 120))

    def _method(self, view: ViewId) -> str:
        wanted = self._options.matting
        given = self.workspace.given_path(view, "mask")
        has_plate = self._plate(view) is not None or self._colour is not None
        if wanted == "auto":
            return "given" if given.exists() else "plate" if has_plate else "fast"
        if wanted == "given" and not given.exists():
            raise DynhairError(
                "no mask came with the recording for this view",
                path=self.workspace.image_path(view),
                mend="choose another matting",
            )
        if wanted == "plate" and not has_plate:
            raise DynhairError(
                f"there is no picture of the empty scene for camera `{view.name}`",
                path=self.workspace.plate_path(view.name),
                mend="say what colour a plain background has by --backdrop, or choose another matting",
            )
        return wanted

    def _target(self, view: ViewId) -> Path:
        return self.workspace.mask_path(view, "mask", raw=self._options.steady)

    def _plate(self, view: ViewId) -> Path | None:
        path = self.workspace.plate_path(view.name)
        return path if not view.is_static and path.exists() else None

    def _extra(self, view: ViewId) -> tuple[Path, ...]:
        plate = self._plate(view)
        match self.methods[view]:
            case "given":
                return (self.workspace.given_path(view, "mask"),)
            case "plate" if plate is not None:
                return (plate,)
        return ()

    def _matting(self, view: ViewId) -> Matting:
        plate = self._plate(view)
        match self.methods[view]:
            case "plate" if plate is not None:
                return plate_matting(read_rgb(plate))
            case "plate":
                assert self._colour is not None, "checked when the step was made"
                return plate_matting(self._colour)
            case "modnet":
                assert self._options.modnet is not None, "checked with the options"
                return modnet_matting(self._options.modnet)
            case "quality":
                return quality_matting()
        return fast_matting()


def _backdrop(workspace: Workspace) -> tuple[int, int, int] | None:
    """The colour that the recording itself says its pictures stand on."""
    background = workspace.manifest.background
    if background is None:
        return None
    red, green, blue = (round(255 * value) for value in background)
    return red, green, blue
