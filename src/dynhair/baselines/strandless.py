"""What heads without strands have in common: they are posed by a head track and drawn as one set of Gaussians."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from jaxtyping import Float
from torch import Tensor, nn

from dynhair.avatar import HeadPose, head_pose
from dynhair.avatar.expression_match import require_expressions
from dynhair.camera import Camera
from dynhair.capture import ExpressionBasis, HeadTrack
from dynhair.config import TrainingConfig
from dynhair.render import Gaussians, rasterize


@dataclass(frozen=True)
class PosedGaussians:
    """A head without strands in one frame, in the world.

    Attributes:
        means: metres.
        quats: wxyz.
        scales: standard deviations, metres.
        opacities: in [0, 1].
        colours: the same from everywhere; None where they depend on the view.
        strands: there are none.
    """

    means: Float[Tensor, "g 3"]
    quats: Float[Tensor, "g 4"]
    scales: Float[Tensor, "g 3"]
    opacities: Float[Tensor, " g"]
    colours: Float[Tensor, "g 3"] | None = None
    strands: None = None


class StrandlessImages(NamedTuple):
    """What the cameras see of a head that does not know what of it is hair.

    Attributes:
        rgb: colour over the background.
        hair: not known.
        body: coverage of everything in [0, 1].
        alpha: the same.
        depth: along the viewing axis, metres, 0 where there is nothing.
    """

    rgb: Float[Tensor, "v h w 3"]
    hair: None
    body: Float[Tensor, "v h w"]
    alpha: Float[Tensor, "v h w"]
    depth: Float[Tensor, "v h w"]


class StrandlessHead(nn.Module, ABC):
    """A head of Gaussians, hair included.

    Args:
        background: colour behind everything.
        expression_size: number of expression coefficients that drive it.
        expression_basis: whose coefficients these are; None if that is not known.
    """

    background: Tensor

    def __init__(
        self, background: Float[Tensor, "3"], expression_size: int, expression_basis: ExpressionBasis | None
    ) -> None:
        super().__init__()
        self.register_buffer("background", background.clone())
        self.expression_size = expression_size
        self.expression_basis = expression_basis

    @abstractmethod
    def posed(self, pose: HeadPose) -> PosedGaussians:
        """The Gaussians in a given pose."""

    @abstractmethod
    def parameter_groups(self, config: TrainingConfig) -> list[dict[str, Any]]:
        """Adam's groups: ``params``, learning rate ``lr`` and a ``name`` each."""

    def colours(
        self, posed: PosedGaussians, cameras: Sequence[Camera]
    ) -> Float[Tensor, "g 3"] | Float[Tensor, "v g 3"]:
        """The posed Gaussians' colours, one set for all cameras or one for each."""
        assert posed.colours is not None
        return posed.colours

    def regularizers(self, config: TrainingConfig) -> dict[str, tuple[float, Tensor]]:
        """Terms of the loss beside those on images, each with its weight."""
        return {}

    def pose(self, track: HeadTrack, frame: int, *, rigid_hair: bool = False) -> PosedGaussians:
        """The head in one frame of a track.

        Args:
            track: head poses and expressions.
            frame: index inside the track.
            rigid_hair: changes nothing, for there is no hair apart.

        Raises:
            DynhairError: the track's expressions are of another face model than the head was trained with.
        """
        require_expressions(track, self.expression_size, self.expression_basis)
        return self.posed(head_pose(track, frame, self.background.device))

    def draw(self, posed: PosedGaussians, cameras: Sequence[Camera]) -> StrandlessImages:
        """Draw the posed head, at the cameras' size."""
        gaussians = Gaussians(posed.means, posed.quats, posed.scales, posed.opacities, self.colours(posed, cameras))
        drawn = rasterize(gaussians, cameras, background=self.background)
        return StrandlessImages(drawn.features, None, drawn.alpha, drawn.alpha, drawn.depth)
