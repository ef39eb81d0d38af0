"""What a calibration file says."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from dynhair.errors import DynhairError
from dynhair.preprocess.sources.recording import SourceCamera, Take, World


@dataclass(frozen=True)
class Calibration:
    """Cameras that stand still.

    Attributes:
        path: the file or folder.
        cameras: by name.
        world: units and axes.
    """

    path: Path
    cameras: Mapping[str, SourceCamera]
    world: World = field(default_factory=World)

    def notes(self, takes: Iterable[Take]) -> tuple[str, ...]:
        """Say which cameras filmed nothing: a video may have been forgotten."""
        filmed = {name for take in takes for name in take.channels}
        idle = [name for name in self.cameras if name not in filmed]
        return (f"calibrated cameras without pictures: {', '.join(idle)}",) if idle else ()

    def fixed(self, name: str) -> Callable[[int], SourceCamera]:
        """Return what gives the camera of this name for every frame.

        That raises DynhairError when it is called, so that a camera that is not used need not be calibrated.
        """

        def camera(_: int) -> SourceCamera:
            if name not in self.cameras:
                raise DynhairError(
                    f"has no camera `{name}`",
                    path=self.path,
                    expected=f"one of that name; there are {', '.join(self.cameras) or 'none'}",
                    mend="calibrate it, or leave it out of the cameras to use",
                )
            return self.cameras[name]

        return camera
