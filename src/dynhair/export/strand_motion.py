"""Hair and head in motion, one frame at a time: what every animated format is written from."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float32, Float64, Int64
from torch import Tensor

from dynhair.avatar import Avatar, HeadMesh, head_pose
from dynhair.avatar.expression_match import require_expressions
from dynhair.capture import HeadTrack
from dynhair.errors import DynhairError
from dynhair.export.bound_mesh import BoundMesh
from dynhair.export.colours import mean_colours, point_colours
from dynhair.export.root_uvs import root_uvs


@dataclass(frozen=True)
class MotionFrame:
    """One frame, in the world, metres.

    Attributes:
        strands: root first.
        head: the head mesh's vertices; None where there is no mesh.
    """

    strands: Float32[np.ndarray, "n l 3"]
    head: Float32[np.ndarray, "v 3"] | None = None


@dataclass(frozen=True)
class StrandMotion:
    """Strands whose number, looks and points do not change over time, and the head that they grow on.

    Frames are made when they are asked for and kept by nobody: a motion may be longer than memory.

    Attributes:
        at: makes the frame of an index from 0 on.
        fps: frames per second.
        widths: full widths of the strands at their points, metres.
        colours: at their points, sRGB in [0, 1], whatever the direction that they are seen from.
        root_uvs: where the roots lie on a texture of the scalp, in [0, 1].
        ids: of the strands; an avatar's strand keeps its id when others are cut away.
        head_transforms: of the head frame in the world, metres, for column vectors, in every frame.
        head_faces: of the head mesh, counter-clockwise seen from outside; None where there is no mesh.
        head_colours: of its vertices, sRGB in [0, 1]; None where they are not known.
    """

    at: Callable[[int], MotionFrame]
    fps: float
    widths: Float32[np.ndarray, "n l"]
    colours: Float32[np.ndarray, "n l 3"]
    root_uvs: Float32[np.ndarray, "n 2"]
    ids: Int64[np.ndarray, " n"]
    head_transforms: Float64[np.ndarray, "f 4 4"]
    head_faces: Int64[np.ndarray, "t 3"] | None = None
    head_colours: Float32[np.ndarray, "v 3"] | None = None

    def __len__(self) -> int:
        return len(self.head_transforms)

    def __iter__(self) -> Iterator[MotionFrame]:
        """The frames in order, each checked.

        Raises:
            DynhairError: a frame's strands are not as many as those of the motion, or not finite.
        """
        for index in range(len(self)):
            yield self._checked(index)

    def _checked(self, index: int) -> MotionFrame:
        frame = self.at(index)
        if frame.strands.shape[:2] != self.widths.shape:
            raise DynhairError(
                f"frame {index} has {' x '.join(map(str, frame.strands.shape[:2]))} points of strands",
                expected=f"{' x '.join(map(str, self.widths.shape))} as in the whole motion",
            )
        if (frame.head is None) != (self.head_faces is None):
            raise DynhairError(f"frame {index} has no head mesh, or one without faces", expected="both or neither")
        if not all(np.isfinite(points).all() for points in (frame.strands, frame.head) if points is not None):
            raise DynhairError(f"frame {index} is not finite", mend="look for a break in the driving motion")
        return frame


def strand_motion(
    avatar: Avatar,
    track: HeadTrack,
    frames: Sequence[int] | None = None,
    *,
    mesh: HeadMesh | None = None,
    rigid_hair: bool = False,
) -> StrandMotion:
    """An avatar that follows a track, frame by frame.

    Args:
        avatar: with its edits; it may not change while frames are made.
        track: head poses and expressions, in the avatar's own world and at its frame rate.
        frames: which of the track's frames, in this order; all by default.
        mesh: the head's surface at rest, to go along; none by default.
        rigid_hair: keep the hair in its canonical shape.

    Raises:
        DynhairError: there are no frames, or the track is of another face model than the avatar was trained with.
    """
    require_expressions(track, avatar.head.expression_size, avatar.expression_basis)
    avatar = avatar.frozen()
    chosen = list(range(len(track.rotations)) if frames is None else frames)
    device = avatar.background.device
    if not chosen:
        raise DynhairError("the motion has no frames", expected="one or more")
    surface = None if mesh is None else BoundMesh.to(avatar, mesh)
    with torch.no_grad():
        conditions = avatar.conditions(track)
        first = avatar.posed(head_pose(track, chosen[0], device), None)
    look, points = first.hair, first.strands.shape[1]

    def at(index: int) -> MotionFrame:
        pose = head_pose(track, chosen[index], device)
        with torch.no_grad():
            posed = avatar.posed(pose, None if rigid_hair else avatar.window(conditions, chosen[index]))
            head = None if surface is None else _array(surface.vertices(pose, posed.head.means))
        return MotionFrame(_array(posed.strands), head)

    return StrandMotion(
        at=at,
        fps=track.fps,
        widths=_array(look.widths[:, None] * point_taper(points).to(device)),
        colours=_array(point_colours(mean_colours(look.base_harmonic).unflatten(0, (len(look.ids), -1)))),
        root_uvs=_array(root_uvs(avatar.canonical_strands[:, 0])[look.ids]),
        ids=look.ids.cpu().numpy(),
        head_transforms=_transforms(track, chosen),
        head_faces=None if mesh is None else mesh.faces.numpy(),
        head_colours=None if surface is None else _array(surface.colours),
    )


def point_taper(points: int, *, length: int = 4, root: float = 0.25) -> Float[Tensor, " l"]:
    """:func:`dynhair.strands.root_taper` at the points of a strand, where that is in the middle of its segments."""
    return (root + (1 - root) * torch.arange(points) / length).clamp_max(1)


def _transforms(track: HeadTrack, frames: Sequence[int]) -> Float64[np.ndarray, "f 4 4"]:
    transforms = np.tile(np.eye(4), (len(frames), 1, 1))
    transforms[:, :3, :3] = track.rotations[frames]
    transforms[:, :3, 3] = track.translations[frames]
    return transforms


def _array(tensor: Tensor) -> np.ndarray:
    return tensor.detach().cpu().float().contiguous().numpy()
