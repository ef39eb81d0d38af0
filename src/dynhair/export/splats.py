"""Splats: a posed avatar as the 3D Gaussians that splat viewers show, and the ``.ply`` files that hold them.

Hair and head become Gaussians of one kind, coloured by spherical harmonics of degree 3, in the order and with the signs
of 3D Gaussian Splatting (Kerbl et al. 2023), which are :func:`~dynhair.avatar.spherical_harmonics.harmonics_basis`'s
own. The hair's harmonics are functions of world directions already, and the head's colours are of degree 0, so that
posing turns none of them.

In files, x is right, y down and z forward, the axes that training from COLMAP cameras left in most of them and that
viewers turn upright. A file's point (x, y, z) is the world's (x, -y, -z).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from dynhair.avatar import Avatar, PosedAvatar
from dynhair.avatar.rotations import multiply_quaternions
from dynhair.avatar.spherical_harmonics import COEFFICIENTS, constant_coefficient, harmonics_basis
from dynhair.camera import Camera
from dynhair.errors import DynhairError
from dynhair.render import Gaussians
from dynhair.storage import atomic_file
from dynhair.strands import root_taper, strand_gaussians, strands_and_body

LARGEST_OPACITY = 1 - 1e-5
"""Of what is opaque, for files hold logits; viewers draw nothing above 0.99 or 0.999."""

HALF_TURN = (0.0, 1.0, 0.0, 0.0)
"""About the x axis, wxyz: between the world's axes and those of files."""

COLUMNS = (
    *("x", "y", "z", "nx", "ny", "nz"),
    *(f"f_dc_{i}" for i in range(3)),
    *(f"f_rest_{i}" for i in range(3 * (COEFFICIENTS - 1))),
    "opacity",
    *(f"scale_{i}" for i in range(3)),
    *(f"rot_{i}" for i in range(4)),
)
"""Of a file's table, as 3D Gaussian Splatting's own code writes them."""


@dataclass(frozen=True)
class Splats:
    """Gaussians with colours that depend on the direction that they are seen along, in the world.

    Attributes:
        means: metres.
        quats: unit, wxyz.
        scales: standard deviations, metres.
        opacities: in [0, 1].
        harmonics: coefficients of each colour; 0.5 is added to their sum.
    """

    means: Float[Tensor, "n 3"]
    quats: Float[Tensor, "n 4"]
    scales: Float[Tensor, "n 3"]
    opacities: Float[Tensor, " n"]
    harmonics: Float[Tensor, "n 16 3"]

    @classmethod
    @torch.no_grad()
    def of(cls, avatar: Avatar, posed: PosedAvatar) -> Splats:
        """A posed avatar's hair and head as :meth:`~dynhair.avatar.Avatar.draw` draws them.

        Two things differ a little. The scalp under the hair takes its colour from the hair as seen from where the scalp
        is, not from where the hair is; and negative colours of the head count as black one by one, not after blending.
        One is lost: with super-resolution, the colours are those before it, without the head's further channels and
        what the network makes of them.
        """
        head, look = posed.head, posed.hair
        hair = strand_gaussians(posed.strands, look.widths, root_taper(posed.strands.shape[1] - 1))
        of_hair = torch.cat([look.base_harmonic, look.higher_harmonics]).transpose(1, 2)
        of_head = head.means.new_zeros(COEFFICIENTS, len(head.means), 3)
        of_head[0] = constant_coefficient(head.colours[:, :3])
        # a mean of colours is the mean of their coefficients, which the layer takes as so many views
        rows, cover, of_scalp = avatar.scalp(of_hair, look)
        of_head[:, rows] = torch.lerp(of_head[:, rows], of_scalp, cover[:, None])
        both = strands_and_body(hair, head, torch.cat([of_hair, of_head], 1))
        return cls(
            means=both.means,
            quats=torch.nn.functional.normalize(both.quats, dim=-1),
            scales=both.scales,
            opacities=both.opacities,
            harmonics=both.features.transpose(0, 1),
        ).drawn()

    def drawn(self) -> Splats:
        """Without those that have a number that is not finite, which no rasterizer draws."""
        parts = [self.means, self.quats, self.scales, self.opacities[:, None], self.harmonics.flatten(1)]
        finite = torch.cat(parts, 1).isfinite().all(1)
        return Splats(*(every[finite] for every in vars(self).values()))

    def seen_from(self, camera: Camera) -> Gaussians:
        """What a rasterizer draws: the splats in the colours that one camera sees."""
        sights = torch.nn.functional.normalize(self.means - camera.centre, dim=-1)
        colours = torch.einsum("kn,nkc->nc", harmonics_basis(sights), self.harmonics)
        return Gaussians(self.means, self.quats, self.scales, self.opacities, (0.5 + colours).clamp_min(0))

    def half_turned(self) -> Splats:
        """Half a turn about the x axis, from the world's axes to those of files or back."""
        flip = self.means.new_tensor([1.0, -1.0, -1.0])
        # a harmonic of the turned direction is plus or minus the harmonic: any direction without zeros tells which
        direction = torch.nn.functional.normalize(self.means.new_tensor([0.3, 0.5, 0.7]), dim=0)
        signs = (harmonics_basis(direction * flip) * harmonics_basis(direction)).sign()
        turn = self.quats.new_tensor(HALF_TURN)
        return Splats(
            means=self.means * flip,
            quats=multiply_quaternions(turn, self.quats),
            scales=self.scales,
            opacities=self.opacities,
            harmonics=self.harmonics * signs[:, None],
        )


def write_splats(path: Path | str, splats: Splats) -> None:
    """Write a ``.ply`` file of splats, atomically: binary, little endian, float32.

    Opacities are written up to :data:`LARGEST_OPACITY`; everything else comes back to a float32's last bits.

    Raises:
        DynhairError: there are none.
    """
    path = Path(path)
    if not len(splats.means):
        raise DynhairError("there is no Gaussian to write", path=path)
    table = splat_table(splats).numpy().astype("<f4")
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment metres; x right, y down, z forward",
        f"element vertex {len(table)}",
        *(f"property float {name}" for name in COLUMNS),
        "end_header",
    ]
    with atomic_file(path) as temporary, temporary.open("wb") as file:
        file.write(("\n".join(header) + "\n").encode("ascii"))
        file.write(table.tobytes())


def splat_table(splats: Splats) -> Float[Tensor, "n 62"]:
    """The numbers of a file, in its :data:`COLUMNS` and its axes, on the CPU in float32."""
    there = splats.half_turned()
    base, higher = there.harmonics[:, 0], there.harmonics[:, 1:]
    columns = [
        there.means,
        torch.zeros_like(there.means),  # normals, which nobody reads
        base,
        higher.transpose(1, 2).flatten(1),  # all of red, then of green and of blue
        there.opacities.clamp_max(LARGEST_OPACITY).logit()[:, None],
        there.scales.log(),
        there.quats,
    ]
    return torch.cat(columns, 1).detach().cpu().float()
