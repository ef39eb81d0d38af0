"""The whole avatar: hair and head, posed and drawn together, stored as one small folder."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dynhair.avatar.deformer import HairDeformer
from dynhair.avatar.drawing import AvatarImages, PosedAvatar, draw_avatar
from dynhair.avatar.driving_pose import Array, RigidPose, rigid_parts
from dynhair.avatar.expression_match import require_expressions
from dynhair.avatar.expression_modes import ExpressionModes
from dynhair.avatar.hair import Hair
from dynhair.avatar.head import Head, HeadGaussians, HeadStart
from dynhair.avatar.head_mesh import HEAD_MESH, HeadMesh
from dynhair.avatar.head_pose import HeadPose, head_pose
from dynhair.avatar.live import SETTLED, LiveAvatar
from dynhair.avatar.model_folder import basis_of, load_model, save_model
from dynhair.avatar.recording import Recording, recording_in
from dynhair.avatar.scalp_layer import ScalpLayer
from dynhair.avatar.strand_dynamics import FPS
from dynhair.avatar.super_resolution import SuperResolution
from dynhair.camera import Camera
from dynhair.capture import ExpressionBasis, HeadTrack
from dynhair.config import DeformerConfig, HeadConfig
from dynhair.editing import CanonicalHair, Edit, EditedHair, HairLook, edits_from_json
from dynhair.errors import DynhairError
from dynhair.motion import SignalNormalizer, motion_signals, motion_window

KIND = "dynhair avatar"
SCHEMA_VERSION = 2


class Avatar(nn.Module):
    """A person's head with moving hair.

    Args:
        hair: strands and their motion.
        head: Gaussians of head and upper body.
        normalizer: scales of the motion signals, from the training motions.
        background: colour behind everything.
        scalp: what makes the skin under the hair count as hair; none by default.
        expression_basis: whose expression coefficients the avatar was trained with; None if that is not known.
        recording: how the person was recorded; None if that is not known.

    Attributes:
        edits: what is changed of the hair after it has been moved, see :meth:`edited`.
        head_mesh: the tracked surface at rest, for other programs: nothing is drawn with it; None if it is not kept.
    """

    background: Tensor

    def __init__(
        self,
        hair: Hair,
        head: Head,
        normalizer: SignalNormalizer,
        background: Float[Tensor, "3"],
        scalp: ScalpLayer | None = None,
        expression_basis: ExpressionBasis | None = None,
        recording: Recording | None = None,
    ) -> None:
        super().__init__()
        self.hair = hair
        self.head = head
        self.normalizer = normalizer
        self.scalp = ScalpLayer.blank(0) if scalp is None else scalp
        self.expression_basis = expression_basis
        self.recording = recording
        self.edits: tuple[Edit, ...] = ()
        self.head_mesh: HeadMesh | None = None
        self._edited_hair: EditedHair | None = None
        factor = head.config.super_resolution
        self.super_resolution = None if factor == 1 else SuperResolution(head.config.colour_channels, factor)
        self.register_buffer("background", background.clone())

    @property
    def canonical_strands(self) -> Float[Tensor, "n l 3"]:
        """The hairstyle as it was trained, at rest in the head frame, metres."""
        return self.hair(None)

    @property
    def resting_strands(self) -> Float[Tensor, "m l 3"]:
        """What edits leave of the hairstyle, at rest in the head frame, metres."""
        return self._after_edits()(self.canonical_strands)

    @property
    def look(self) -> HairLook:
        """How the strands look that edits leave."""
        return self._after_edits().look if self.edits else self.hair.look

    def conditions(self, track: HeadTrack) -> Float[Tensor, "f c"]:
        """Normalised motion conditions of a whole track, on the avatar's device."""
        return self.normalizer(motion_signals(track).to(self.background.device))

    def window(self, conditions: Float[Tensor, "f c"], frame: int) -> Float[Tensor, "t c"]:
        """The conditions that the hair of ``frame`` depends on."""
        return motion_window(conditions, frame, self.hair.deformer.config.history)

    def deformed_strands(self, track: HeadTrack, frames: Sequence[int]) -> Float[Tensor, "b n l 3"]:
        """Strands in the head frame, metres, in the given frames of a track."""
        conditions = self.conditions(track)
        return torch.stack([self.hair(self.window(conditions, frame)) for frame in frames])

    def pose(self, track: HeadTrack, frame: int, *, rigid_hair: bool = False) -> PosedAvatar:
        """The avatar in one frame of a track.

        Args:
            track: head poses and expressions.
            frame: index inside the track.
            rigid_hair: keep the hair in its canonical shape.

        Raises:
            DynhairError: the track's expressions are of another face model than the avatar was trained with.
        """
        require_expressions(track, self.head.expression_size, self.expression_basis)
        window = None if rigid_hair else self.window(self.conditions(track), frame)
        return self.posed(head_pose(track, frame, self.background.device), window)

    def posed(self, pose: HeadPose, window: Float[Tensor, "t c"] | None) -> PosedAvatar:
        """The avatar in a given pose, with hair under the given motion conditions (None: rigid)."""
        return self.with_strands(self.hair(window) @ pose.rotation.T + pose.translation, self.head(pose))

    def with_strands(self, strands: Float[Tensor, "n l 3"], head: HeadGaussians) -> PosedAvatar:
        """The avatar with all of its strands, in any shape, and head as given in the world, and then edited."""
        return PosedAvatar(self._after_edits()(strands) if self.edits else strands, head, self.look)

    def edited(self, *edits: Edit) -> Avatar:
        """The avatar with further edits of its hair, in :meth:`posed` and wherever it is drawn; tensors are shared.

        Edits are worked out once, from the hair as it then is: edit an avatar that is trained.

        Raises:
            DynhairError: an edit does not fit the hair.
        """
        return self.with_edits((*self.edits, *edits))

    def with_edits(self, edits: Sequence[Edit]) -> Avatar:
        """The avatar with these edits in the place of all that it has; none undoes them."""
        other = copy.copy(self)
        other.edits, other._edited_hair = tuple(edits), None
        other._after_edits()  # refuses edits that do not fit
        return other

    def _after_edits(self) -> EditedHair:
        """What the edits make of the strands, worked out once on a device."""
        made, like = self._edited_hair, self.hair.base_harmonic
        if made is None or (made.look.base_harmonic.device, made.look.base_harmonic.dtype) != (like.device, like.dtype):
            # ordinary tensors, whatever mode the avatar is first posed in
            with torch.inference_mode(False), torch.no_grad():
                hair = CanonicalHair.of(self.canonical_strands, self.hair.look)
                for edit in self.edits:
                    hair = edit.apply(hair)
                made = self._edited_hair = EditedHair(hair)
        return made

    def frozen(self) -> Avatar:
        """The avatar for drawing alone: the same images but for rounding, sooner and without gradients.

        It shares this one's tensors, which may not change afterwards, and can be edited and driven as this one.
        """
        from dynhair.avatar.frozen import FrozenAvatar  # it builds on this module

        return FrozenAvatar(self)

    def live(self, fps: float | None = None, delay: int = SETTLED) -> LiveAvatar:
        """Drive the avatar one head pose at a time, see :class:`~dynhair.avatar.live.LiveAvatar`.

        Args:
            fps: frames per second of the motion; that of the avatar's recording by default.
            delay: frames that the result is late: 2 for that of :meth:`pose`, 0 for an answer at once.

        Raises:
            DynhairError: no frame rate is given or known, or the delay is another.
        """
        return LiveAvatar(self, fps, delay)

    @torch.no_grad()
    def render(
        self, pose: RigidPose, expression: Array | None = None, camera: Camera | None = None
    ) -> Float[Tensor, "h w 3"]:
        """One image of the avatar holding still: its hair hangs at rest under the pose's gravity.

        Args:
            pose: of the head: a :class:`HeadPose`, a matrix (4, 4) from the head frame to the world, or rotation (3, 3)
                and translation (3,) in metres.
            expression: coefficients of the face model; by default the pose's own, or those of the rest frame.
            camera: who looks; the recording's most frontal camera by default.

        Returns:
            sRGB in [0, 1] over the avatar's background.

        Raises:
            DynhairError: the pose is none, the expression is of another face model, or no camera is given or known.
        """
        if camera is None:
            if self.recording is None:
                raise DynhairError("the avatar does not say where it was recorded from", mend="name a camera")
            camera = self.recording.camera
        if expression is None and isinstance(pose, HeadPose):
            expression = pose.expression
        still = self.live(fps=1.0, delay=0)  # one frame has no velocity, whatever the frame rate
        posed = still.step(*rigid_parts(pose), expression)
        assert posed is not None
        return self.draw(posed, [camera.to(self.background.device)]).rgb[0].clamp(0, 1)

    def draw(self, posed: PosedAvatar, cameras: Sequence[Camera]) -> AvatarImages:
        """Draw hair and head together in one pass: colour, labels, hair direction.

        With super-resolution, the pass is smaller than the cameras' images by its factor; a network makes the colours
        of the full size, and the rest is enlarged bilinearly.

        Raises:
            DynhairError: with super-resolution, the images' sides are not multiples of its factor.
        """
        return draw_avatar(posed, cameras, self.scalp, self.background, self.super_resolution)

    def save(self, path: Path | str) -> None:
        """Write the avatar as a folder, atomically: ``avatar.json``, ``avatar.safetensors`` and the head mesh, if any.

        Raises:
            DynhairError: it cannot be written, for want of space or otherwise.
        """
        description = {
            "strand_width": self.hair.width,
            "expression_size": self.head.expression_size,
            "dynamic": isinstance(self.hair.deformer, HairDeformer),
            "deformer": dataclasses.asdict(self.hair.deformer.config),
            "head": dataclasses.asdict(self.head.config),
            "expression_basis": None if self.expression_basis is None else self.expression_basis.to_json(),
            "recording": None if self.recording is None else self.recording.to_json(),
            "edits": [edit.to_json() for edit in self.edits],
        }
        further = {} if self.head_mesh is None else {HEAD_MESH: self.head_mesh.to_tensors()}
        save_model(self, path, KIND, description, version=SCHEMA_VERSION, further=further)

    @classmethod
    def load(cls, path: Path | str, device: torch.device | str = "cpu") -> Avatar:
        """Open an avatar's folder. Nothing in it is executed.

        Raises:
            DynhairError: a file is missing, damaged, of a later version, or does not fit the others.
        """
        avatar = load_model(path, KIND, cls._like, device, version=SCHEMA_VERSION)
        avatar.head_mesh = HeadMesh.read(Path(path))
        return avatar

    @classmethod
    def _like(cls, description: Mapping[str, Any], tensors: Mapping[str, Tensor]) -> Avatar:
        # an avatar that says nothing of knots or of rigid hair was written before there were any
        dynamic, deformer = description.get("dynamic", True), DeformerConfig(**{"knots": 0, **description["deformer"]})
        strands = tensors["hair.deformer.addresses"] if dynamic else tensors["hair.strands"]
        recording = recording_in(description)
        fps = FPS if recording is None else recording.fps
        hair = Hair(strands, float(description["strand_width"]), torch.zeros(3), deformer, dynamic, fps)
        rest = HeadPose(torch.eye(3), torch.zeros(3), torch.zeros(3), torch.zeros(int(description["expression_size"])))
        coefficients, rows, _ = tensors["head.modes.offsets"].shape
        modes = ExpressionModes.blank(len(rest.expression), coefficients, rows)
        start = HeadStart.blank(len(tensors["head.means"]), modes)
        head = Head(start, torch.zeros(1, 3), rest, HeadConfig(**description["head"]))
        scalp = ScalpLayer.blank(*tensors["scalp.strands"].shape)
        normalizer = SignalNormalizer(deformer)
        avatar = cls(hair, head, normalizer, torch.zeros(3), scalp, basis_of(description), recording)
        avatar.edits = edits_from_json(description.get("edits", []))
        return avatar
