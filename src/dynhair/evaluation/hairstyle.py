"""How well a hairstyle at rest has been reconstructed: from views seen and held out, and against true strands.

The hair is drawn together with the opaque head and body, as training draws it, and held against the views of the rest
frame and the static views around the motionless head. Some static views training never sees: a hairstyle that only
explains the views it was fitted to gives itself away there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.avatar import head_pose
from dynhair.capture import Capture
from dynhair.evaluation.metrics import SILHOUETTE_THRESHOLD, silhouette, silhouette_iou
from dynhair.evaluation.strand_scores import QUERIES, STEP, StrandScore, strand_scores
from dynhair.evaluation.truth import true_hairstyle
from dynhair.render import Gaussians
from dynhair.strands import MeshDistance
from dynhair.training.frames import rest_frame
from dynhair.training.static_hair import strand_width
from dynhair.training.static_scene import render_hair, surface_gaussians
from dynhair.training.static_views import RestViews, rest_views
from dynhair.training.surface import tracked_surface

LARGEST_IMAGE = 512
"""Longer side to which larger views are reduced, pixels."""

CONFIDENT = 0.5
"""Coherence of the orientation map above which a pixel's direction counts."""

HAIRSTYLE_DEFINITIONS: Mapping[str, str] = {
    "iou": "intersection over union of the drawn and the stored hair silhouettes (pixels with coverage above "
    f"{SILHOUETTE_THRESHOLD:g}), drawn with the opaque tracked surface; mean over views of at most {LARGEST_IMAGE} "
    "pixels along the longer side",
    "orientation_error": "degrees between the drawn hair's and the orientation map's undirected direction; mean over "
    f"the pixels of all views that are hair in both silhouettes and whose coherence is above {CONFIDENT:g}",
    "inside": "share of the strands' points, roots left out, with a signed distance to the tracked surface below 0; "
    "no tolerance",
    "strands": "precision, recall and F-score of points on the strands against all true strands of the rest frame: a "
    "point matches if any point of the other side is within the distance (metres) and within the angle (degrees, "
    f"undirected); points at most {1e3 * STEP:g} mm apart along each strand, {QUERIES} random ones of either side "
    "looked up among all of the other",
}
"""What each figure of a hairstyle means."""


@dataclass(frozen=True)
class ViewFigures:
    """A hairstyle against some views.

    Attributes:
        views: their number.
        iou: mean intersection over union of the silhouettes; None where no view shows hair.
        orientation_error: mean angle between the directions, degrees; None where no pixel tells.
        orientation_pixels: over how many pixels.
    """

    views: int
    iou: float | None
    orientation_error: float | None
    orientation_pixels: int


@dataclass(frozen=True)
class HairstyleScores:
    """The figures of a hairstyle at rest, see `HAIRSTYLE_DEFINITIONS`.

    Attributes:
        seen: against the views that training sees.
        held_out: against those that it does not.
        inside: share of the strands' points that lie inside the head or the body.
        strands: against the true strands, one score a threshold; None where the capture does not hold them.
    """

    seen: ViewFigures
    held_out: ViewFigures
    inside: float
    strands: tuple[StrandScore, ...] | None

    def to_json(self) -> dict[str, Any]:
        """Lay out the figures by name."""
        return asdict(self)


@dataclass(frozen=True)
class HairstyleEvaluation:
    """The hair at rest of one capture, at several stages of its making.

    Attributes:
        scores: by name of the stage, in their order.
        protocol: what was held against what, in words.
    """

    scores: Mapping[str, HairstyleScores]
    protocol: Mapping[str, str]

    def to_json(self) -> dict[str, Any]:
        """Lay out each stage's figures by its name, and beside them protocol and definitions."""
        return {
            **{name: scores.to_json() for name, scores in self.scores.items()},
            "protocol": dict(self.protocol),
            "definitions": dict(HAIRSTYLE_DEFINITIONS),
        }


def evaluate_hairstyles(
    capture: Capture,
    hairstyles: Mapping[str, Float[Tensor, "_ _ 3"]],
    widths: Mapping[str, Float[Tensor, " _"]] | None = None,
) -> HairstyleEvaluation:
    """Score several hairstyles of one person.

    Args:
        capture: with hair masks.
        hairstyles: by name, head frame, metres.
        widths: of the strands of some hairstyles, metres; those of others have the width that training gives as many.

    Raises:
        DynhairError: the capture has no hair masks, or neither a tracked mesh nor landmarks.
    """
    widths = widths or {}
    scores = {name: hairstyle_scores(capture, hair, width=widths.get(name)) for name, hair in hairstyles.items()}
    segment, index = rest_frame(capture)
    truth = true_hairstyle(capture, segment.start + index)
    sizes = (f"{name} {len(strands)} strands of {strands.shape[1]} points" for name, strands in hairstyles.items())
    return HairstyleEvaluation(
        scores,
        {
            "frame": f"{segment.start + index}, and the static views",
            "held_out": "every eighth static view, which training never sees",
            "hairstyles": "; ".join(sizes),
            "true_strands": "none" if truth is None else f"all {len(truth)} of {truth.shape[1]} points",
        },
    )


@torch.no_grad()
def hairstyle_scores(
    capture: Capture, strands: Float[Tensor, "n l 3"], *, width: float | Float[Tensor, " n"] | None = None
) -> HairstyleScores:
    """Score a hairstyle against a capture's views of the hair at rest, and its true strands where it has them.

    Args:
        capture: with hair masks.
        strands: the hairstyle, head frame, metres, root first.
        width: at which strands are drawn, metres; that of training for as many strands if not given.

    Raises:
        DynhairError: the capture has no hair masks, or neither a tracked mesh nor landmarks.
    """
    strands = strands.detach().cpu().float()
    if width is None:
        width = strand_width(len(strands))
    elif isinstance(width, Tensor):
        width = width.detach().cpu().float()
    segment, index = rest_frame(capture)
    frame, pose = segment.start + index, head_pose(capture.track(segment), index)
    surface = tracked_surface(capture)
    vertices = (surface.vertices(frame) - pose.translation) @ pose.rotation
    body = surface_gaussians(vertices, surface.faces)

    def against(*, held_out: bool) -> ViewFigures:
        views = rest_views(capture, frame, pose, held_out=held_out, largest=LARGEST_IMAGE)
        return _view_figures(strands, width, body, views)

    distances, _ = MeshDistance(vertices, surface.faces).query(strands[:, 1:].flatten(0, 1))
    truth = true_hairstyle(capture, frame)
    return HairstyleScores(
        seen=against(held_out=False),
        held_out=against(held_out=True),
        inside=(distances < 0).double().mean().item(),
        strands=None if truth is None else tuple(strand_scores(strands, (truth - pose.translation) @ pose.rotation)),
    )


def _view_figures(
    strands: Float[Tensor, "n l 3"], width: float | Float[Tensor, " n"], body: Gaussians, views: RestViews
) -> ViewFigures:
    overlaps, angles = [torch.empty(0)], [torch.empty(0)]
    for place, camera in enumerate(views.cameras):  # one at a time, for large views take much memory
        drawn, view = render_hair(strands, width, body, [camera]), views[[place]]
        overlaps.append(silhouette_iou(silhouette(drawn.coverage), silhouette(view.hair)))
        hair = silhouette(drawn.coverage) & silhouette(view.hair)
        confident = hair & (view.direction.norm(dim=-1) > CONFIDENT * view.hair)
        angles.append(_angles(drawn.direction[confident], view.direction[confident]))
    overlap = torch.cat(overlaps).double()
    overlap = overlap[~overlap.isnan()]  # of views in which either silhouette has a pixel
    degrees = torch.cat(angles).double()
    return ViewFigures(
        views=len(views),
        iou=overlap.mean().item() if len(overlap) else None,
        orientation_error=degrees.mean().item() if len(degrees) else None,
        orientation_pixels=len(degrees),
    )


def _angles(first: Float[Tensor, "p 2"], second: Float[Tensor, "p 2"]) -> Float[Tensor, " p"]:
    """Degrees between undirected directions given as doubled angles of any magnitude, in [0, 90]."""
    sine = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    return torch.rad2deg(torch.atan2(sine.abs(), (first * second).sum(1))) / 2
