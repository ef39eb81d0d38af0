"""A physics simulator in the place of the network that moves the hair (paper, Table 1, "Maya").

The paper simulates 200 guides of 16 points in Maya and lets the hairstyle follow them; Newton's cables do here what
Maya does there. Strands, colours and head are those of a trained avatar.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import safetensors.torch
import torch
from jaxtyping import Float, Int
from torch import Tensor

from dynhair.avatar import Avatar, head_pose
from dynhair.avatar.drawing import AvatarImages, PosedAvatar
from dynhair.avatar.model_folder import DESCRIPTION, TENSORS, read_description, read_tensors
from dynhair.baselines.cables import CableParameters, Cables, Part
from dynhair.baselines.simulator_guides import GuideInterpolation, unkinked
from dynhair.baselines.simulator_motion import RigidMotion
from dynhair.baselines.simulator_training import train_simulator
from dynhair.camera import Camera
from dynhair.capture import Capture, HeadTrack
from dynhair.errors import DynhairError
from dynhair.storage import atomic_folder, write_json
from dynhair.strands import MeshDistance, resample_strands
from dynhair.strands.collision import push_out
from dynhair.strands.spreading import farthest_points
from dynhair.training.frames import head_frame, rest_frame
from dynhair.training.surface import tracked_surface

__all__ = ["HeadSurface", "SimulatedAvatar", "train_simulator"]

KIND = "dynhair simulator baseline"
VERSION = 1
APPEARANCE = "appearance"
"""The folder of the avatar that the hair, its colours and the head are taken from."""

GUIDES, GUIDE_POINTS = 200, 16  # paper, supplement, "Baselines"
OVERLAP = 0.75  # the head's part has faces that follow it by more than a quarter, the body's by less than this
TRACKS_KEPT = 8


@dataclasses.dataclass(frozen=True)
class HeadSurface:
    """What the hair collides with: the tracked surface of the rest frame, in that frame's head frame.

    Attributes:
        vertices: metres.
        faces: triangles, counter-clockwise seen from outside.
        follow: of each vertex, 0 for one that moves with the body to 1 for one that moves with the head.
    """

    vertices: Float[Tensor, "v 3"]
    faces: Int[Tensor, "f 3"]
    follow: Float[Tensor, " v"]

    @classmethod
    def tracked(cls, capture: Capture) -> HeadSurface:
        """The capture's tracked mesh, or the open head in its place.

        Raises:
            DynhairError: the capture has neither a tracked mesh nor landmarks of a face.
        """
        surface = tracked_surface(capture)
        segment, index = rest_frame(capture)
        vertices = head_frame(capture.track(segment), index)(surface.vertices(segment.start + index))
        return cls(vertices, surface.faces, surface.follow)

    def parts(self) -> tuple[Part, Part]:
        """What moves with the head and what moves with the body; the neck between belongs to both."""
        follow = self.follow[self.faces].mean(1)
        vertices, faces = self.vertices.numpy().astype(np.float64), self.faces.numpy()
        head, body = (follow > 1 - OVERLAP).numpy(), (follow < OVERLAP).numpy()
        return Part(vertices, faces[head]), Part(vertices, faces[body])


class SimulatedAvatar:
    """An avatar whose hair is simulated. It is a :class:`~dynhair.evaluation.protocol.DrivenHead`.

    A track is simulated as a whole when its first frame is asked for, and the last few tracks are kept.

    Args:
        avatar: whose canonical strands, colours and head these are.
        surface: that the hair collides with.
        parameters: of the simulation.
        guides: number of strands that are simulated.
    """

    def __init__(
        self,
        avatar: Avatar,
        surface: HeadSurface,
        parameters: CableParameters | None = None,
        guides: int = GUIDES,
    ) -> None:
        self.avatar, self.surface, self.parameters = avatar, surface, parameters or CableParameters()
        self.guides = guides
        strands = avatar.canonical_strands.detach()
        chosen = farthest_points(strands[:, 0], guides)
        self._interpolation = GuideInterpolation(strands, chosen)
        rest = resample_strands(strands[chosen], GUIDE_POINTS).cpu().float()
        # Where the avatar's strands dip into the skin, a cable would be caught inside.
        obstacle = MeshDistance(surface.vertices, surface.faces)
        outside = push_out(rest.flatten(0, 1), obstacle, self.parameters.contact_radius).view_as(rest)
        self._rest = unkinked(torch.cat([rest[:, :1], outside[:, 1:]], 1).double())
        self._tracks: OrderedDict[bytes, Float[Tensor, "f g m 3"]] = OrderedDict()

    @property
    def background(self) -> Float[Tensor, "3"]:
        """Colour behind everything."""
        return self.avatar.background

    def pose(self, track: HeadTrack, frame: int, *, rigid_hair: bool = False) -> PosedAvatar:
        """The avatar in one frame of a track.

        Args:
            track: head poses and expressions.
            frame: index inside the track.
            rigid_hair: keep the hair in its canonical shape.

        Raises:
            DynhairError: the track's expressions are of another face model than the avatar was trained with, or the
                simulation diverges.
        """
        posed = self.avatar.pose(track, frame, rigid_hair=True)
        if rigid_hair:
            return posed
        pose = head_pose(track, frame, posed.strands.device)
        strands = self._interpolation(self.displacements(track)[frame])
        return self.avatar.with_strands(strands @ pose.rotation.T + pose.translation, posed.head)

    def draw(self, posed: PosedAvatar, cameras: Sequence[Camera]) -> AvatarImages:
        """Draw the posed avatar as the one that it was made from."""
        return self.avatar.draw(posed, cameras)

    def displacements(self, track: HeadTrack) -> Float[Tensor, "f g m 3"]:
        """What the guides' points have moved by since rest in every frame of a track, head frame, metres."""
        key = _digest(track)
        if key not in self._tracks:
            self._tracks[key] = self._simulate(track)
            if len(self._tracks) > TRACKS_KEPT:
                self._tracks.popitem(last=False)
        self._tracks.move_to_end(key)
        return self._tracks[key]

    def _simulate(self, track: HeadTrack) -> Float[Tensor, "f g m 3"]:
        cables = Cables(self._rest.numpy(), self.surface.parts(), self.parameters, track.gravity)
        motions = RigidMotion(track.rotations, track.translations, track.fps), self._body_motion(track)
        moved = []
        for frame, strands in enumerate(cables.simulate(motions)):
            in_head = (strands - track.translations[frame]) @ track.rotations[frame]
            moved.append(torch.from_numpy(in_head) - self._rest)
        return torch.stack(moved).float()

    @torch.no_grad()
    def _body_motion(self, track: HeadTrack) -> RigidMotion:
        """How the avatar's body moves, for nothing tracks it."""
        device = self.avatar.background.device
        places = [
            self.avatar.head.skinning.body(head_pose(track, frame, device)) for frame in range(len(track.rotations))
        ]
        rotations = torch.stack([rotation for rotation, _ in places]).double().cpu().numpy()
        translations = torch.stack([translation for _, translation in places]).double().cpu().numpy()
        return RigidMotion(rotations, translations, track.fps)

    def save(self, path: Path | str) -> None:
        """Write the avatar as a folder, atomically: ``avatar.json``, ``avatar.safetensors`` and ``appearance``."""
        description = {
            "kind": KIND,
            "version": VERSION,
            "guides": self.guides,
            "parameters": dataclasses.asdict(self.parameters),
        }
        surface = {field.name: getattr(self.surface, field.name) for field in dataclasses.fields(self.surface)}
        with atomic_folder(path) as folder:
            write_json(folder / DESCRIPTION, description)
            safetensors.torch.save_file({k: v.contiguous() for k, v in surface.items()}, folder / TENSORS)
            self.avatar.save(folder / APPEARANCE)

    @classmethod
    def load(cls, path: Path | str, device: torch.device | str = "cpu") -> SimulatedAvatar:
        """Open such a folder. Nothing in it is executed.

        Raises:
            DynhairError: a file is missing, damaged, of a later version, or does not fit the others.
        """
        path = Path(path)
        description, tensors = read_description(path, KIND, VERSION), read_tensors(path)
        try:
            surface = HeadSurface(**tensors)
            parameters, guides = CableParameters(**description["parameters"]), int(description["guides"])
        except (KeyError, TypeError, ValueError) as error:
            raise DynhairError(
                f"the surface or the parameters are damaged ({error})", path=path, mend="write the folder again"
            ) from None
        return cls(Avatar.load(path / APPEARANCE, device), surface, parameters, guides)


def _digest(track: HeadTrack) -> bytes:
    """A name for everything about a track that moves the hair."""
    digest = hashlib.blake2b()
    for array in (track.rotations, track.translations, track.gravity, np.array(track.fps)):
        digest.update(np.ascontiguousarray(array, np.float64).tobytes())
    return digest.digest()
