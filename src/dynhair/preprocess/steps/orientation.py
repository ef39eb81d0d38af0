"""The direction of hair in every view."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from dynhair.capture.encoding import decode_orientation, read_orientation
from dynhair.pictures import Picture
from dynhair.preprocess.jobs import Job
from dynhair.preprocess.orientation import gabor_orientation
from dynhair.preprocess.sheets import hue
from dynhair.preprocess.steps.step import Step
from dynhair.preprocess.workspace import ViewId


class OrientationStep(Step[ViewId]):
    """Writes ``orient_*.png``: where there is no hair, nothing is known."""

    name, title = "orient", "Hair orientation"

    def settings(self) -> Mapping[str, Any]:
        return {"filters": "Gabor"}

    def jobs(self) -> Sequence[Job[ViewId]]:
        path = self.workspace.image_path
        return [Job(view, (path(view), path(view, "hair")), (path(view, "orient"),)) for view in self.workspace.views]

    def worker(self) -> Callable[[ViewId], None]:
        def work(view: ViewId) -> None:
            angle, coherence = gabor_orientation(self.workspace.image(view))
            hair = self.workspace.mask(view, "hair").astype(np.float32) / 255
            self.workspace.write_orientation(view, angle, coherence * hair)

        return work

    def picture(self, view: ViewId) -> Picture:
        angle, coherence = decode_orientation(read_orientation(self.workspace.image_path(view, "orient")))
        return hue(angle.numpy(), coherence.numpy())
