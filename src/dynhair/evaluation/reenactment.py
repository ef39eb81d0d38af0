"""Cross-reenactment: another person's motion drives the avatar, of which no image is true; its motion is measured."""

from __future__ import annotations

from collections.abc import Callable

import torch

from dynhair.capture import Capture, Segment
from dynhair.evaluation.cost import Stopwatch
from dynhair.evaluation.definitions import DEFINITIONS, PENETRATION_FIGURES, PHYSICS_FIGURES, SPEED_FIGURES
from dynhair.evaluation.figures import FigureSums
from dynhair.evaluation.held_out import HeldOutViews
from dynhair.evaluation.metrics import silhouette
from dynhair.evaluation.motion_meter import MotionMeter
from dynhair.evaluation.protocol import DrivenHead, draw
from dynhair.evaluation.recorder import most_frontal_view
from dynhair.evaluation.records import Evaluation, ReenactedFrame, SegmentFigures
from dynhair.evaluation.retargeting import ON_HEAD, Retargeting
from dynhair.evaluation.segment_meter import posed_hair
from dynhair.evaluation.series import Series
from dynhair.evaluation.settling import sudden_stop
from dynhair.evaluation.true_motion import RestingHair, in_head
from dynhair.strands import MeshDistance
from dynhair.training.rest import Rest

OWN_FIGURES = (*SPEED_FIGURES, *PHYSICS_FIGURES, *PENETRATION_FIGURES, "stretch", "settling_s")
"""What is measured: the figures of a method's hair by itself."""

NO_TRUTH = "the motion is another person's: nothing true is known of the avatar in it"


@torch.no_grad()
def reenact(
    avatar: DrivenHead, own: Capture, driver: Capture, *, observe: Callable[[ReenactedFrame], None] | None = None
) -> Evaluation:
    """Drive an avatar by the test segments of another person's capture; by all, if none is a test.

    Penetration is that of the avatar's own head at rest, body aside: the driver's shoulders are not the avatar's.

    Args:
        avatar: what is driven.
        own: the capture that it was trained on, from which its pose and its head at rest are taken.
        driver: the other person's.
        observe: called with each frame's images.

    Raises:
        DynhairError: the avatar renders values that are not finite.
    """
    watch, session = Stopwatch(), _Session(avatar, own, driver)
    tests = [segment for segment in driver.segments if segment.split == "test"] or list(driver.segments)
    overall, segments = FigureSums(), []
    for segment in tests:
        sums, series = session.measure(segment, watch, observe)
        segments.append(SegmentFigures(segment, sums.figures(), None, series.values))
        overall.merge(sums)
    return Evaluation(
        avatar=overall.figures(),
        rigid=None,
        segments=tuple(segments),
        held_out=None,
        held_out_views=HeldOutViews(reason=NO_TRUTH),
        protocol=session.protocol(tests),
        image_size=(session.camera.width, session.camera.height),
        cost=watch.cost(overall.frames, 1),
    )


class _Session:
    """What all segments share."""

    def __init__(self, avatar: DrivenHead, own: Capture, driver: Capture) -> None:
        self.avatar, self.own, self.driver = avatar, own, driver
        self.retargeting, rest = Retargeting(own, driver), Rest.of(own)
        self.obstacle = _own_head(own, rest)
        self.posed = avatar.pose(rest.track, rest.index, rigid_hair=True)
        strands = self.posed.strands
        self.rest = RestingHair.of(None if strands is None else in_head(strands, rest.track, rest.index), None)
        views = own.views([(rest.frame, name) for name in own.camera_names])
        masks = [view.hair for view in views if view.hair is not None]
        self.hair = silhouette(torch.stack(masks)) if len(masks) == len(views) else None
        self.cameras = [own.camera(rest.frame, name) for name in own.camera_names]
        self.camera = self.cameras[most_frontal_view(own, rest.segment, rest.index)]
        start = driver.segments[0]
        self.view = driver.camera_names[most_frontal_view(driver, start, 0)]

    def measure(
        self, segment: Segment, watch: Stopwatch, observe: Callable[[ReenactedFrame], None] | None
    ) -> tuple[FigureSums, Series]:
        """Drive the avatar by all frames of a segment."""
        track, fps = self.retargeting.track(segment), self.driver.fps
        sums, series = FigureSums(), Series(segment, fps)
        meter = MotionMeter(fps, self.rest, None, sudden_stop(track), sums, series, consecutive=True)
        if self.posed.strands is None:
            meter.choose_points(self.posed.means, self.hair, self.cameras)
        for index in range(segment.count):
            sums.add_frame(images=1)
            with watch.part("drawing"):
                posed = self.avatar.pose(track, index)
                drawn = draw(self.avatar, posed, [self.camera], f"frame {index} of '{segment.name}'")
            with watch.part("figures"):
                meter.add(index, posed_hair(posed, track, index), self.obstacle)
            if observe is not None:
                with watch.part("pictures"):
                    driver = self.driver.view(segment.frames[index], self.view).rgb
                    observe(ReenactedFrame(segment, index, driver, drawn.rgb[0]))
        meter.finish()
        sums.explain(NO_TRUTH, *(name for name in DEFINITIONS if name not in OWN_FIGURES))
        return sums, series

    def protocol(self, segments: list[Segment]) -> dict[str, str]:
        """Say in words what drove what."""
        names = ", ".join(segment.name for segment in segments)
        return {
            "capture": self.driver.name,
            "drive": f"cross-reenactment: the tracked head of another person, {self.driver.name}, moved as a whole so "
            f"that its pose at rest is that of the avatar's own capture, {self.own.name}",
            "expressions": self.retargeting.expressions,
            "frames": f"every frame of {names}",
            "views": f"the avatar's most frontal camera, {self.camera.width}x{self.camera.height} pixels",
            "rigid": "none: no figure compares with it",
            "obstacle": "the avatar's own tracked head at rest" if self.obstacle is not None else "none",
            "true_strands": "none",
            "networks": "none: there are no true images",
        }


def _own_head(own: Capture, rest: Rest) -> MeshDistance | None:
    """The tracked head at rest in its own frame; None where there is no mesh."""
    mesh = own.mesh
    if mesh is None:
        return None
    vertices = in_head(torch.from_numpy(own.vertices(rest.frame)), rest.track, rest.index).float()
    faces = mesh.faces[(mesh.follow >= ON_HEAD)[mesh.faces].all(axis=1)]
    return MeshDistance(vertices, torch.from_numpy(faces)) if len(faces) else None
