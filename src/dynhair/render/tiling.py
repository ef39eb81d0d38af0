"""From Gaussians to lists of what to blend in each tile of an image, on the CPU."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import torch
from torch import Tensor

from dynhair.camera import Camera
from dynhair.errors import DynhairError
from dynhair.render import kernels
from dynhair.render.kernels import SPLAT_HEADER, TILE
from dynhair.render.parallel import share, slices_per_view
from dynhair.render.workspace import Workspace
from dynhair.threads import run

CHANNEL_STEP = 4  # blending kernels are compiled for multiples of this
FIELD_OF_VIEW_MARGIN = 0.3
MOST_ENTRIES = 2**31 - 1


@dataclass(frozen=True)
class TileLists:
    """One view's projected Gaussians ("splats") and, for each tile of the image, which of them to blend.

    Attributes:
        splats: ``(n, stride)``, see ``Field`` in common.cpp.
        starts: ``(tiles + 1,)``, where each tile's list starts.
        entries: the lists, indices of splats, front to back.
        reached: for each entry the blocks of the tile to which it contributed, filled by the blend.
        ends: ``(tiles,)``, how far the blend read each list.
    """

    splats: Tensor
    starts: Tensor
    entries: Tensor
    reached: Tensor
    ends: Tensor

    @property
    def tensors(self) -> tuple[Tensor, ...]:
        return self.splats, self.starts, self.entries, self.reached, self.ends


def pack_camera(camera: Camera) -> Tensor:
    """Lay out w2c, fx, fy, cx, cy, and the slopes that the Jacobian is held between, as the kernels want them."""
    camera = camera.to("cpu", torch.float64)
    focal, centre = camera.K.diagonal()[:2], camera.K[:2, 2]
    size = torch.tensor([camera.width, camera.height], dtype=torch.float64)
    margin = FIELD_OF_VIEW_MARGIN * size / 2 / focal
    slopes = torch.stack([-centre / focal - margin, (size - centre) / focal + margin], dim=1)
    return torch.cat([camera.w2c.reshape(-1), focal, centre, slopes.reshape(-1)]).detach().float()


def feature_room(channels: int) -> int:
    """Round feature channels up to what blending kernels are compiled for."""
    return -(-channels // CHANNEL_STEP) * CHANNEL_STEP


def list_splats(
    workspace: Workspace, attributes: Sequence[Tensor], features: Tensor, views: Tensor, width: int, height: int
) -> list[TileLists]:
    """Project Gaussians into each view, sort them by depth and list them by tile.

    Args:
        workspace: where the lists are to live.
        attributes: means, quaternions, scales and opacities.
        features: ``(n, c)`` or ``(v, n, c)``.
        views: ``(v, 20)``, see :func:`pack_camera`.
        width: of the images, in pixels.
        height: of the images, in pixels.
    """
    n, channels, slices = len(attributes[0]), features.shape[-1], slices_per_view(len(views))
    stride = SPLAT_HEADER + feature_room(channels)
    columns, rows = -(-width // TILE), -(-height // TILE)
    tiles = columns * rows
    ranges = share(n, slices)
    passing = Workspace()  # for what is needed no longer than this function runs
    splats = [workspace.empty(n, stride) for _ in views]
    bounds = [passing.empty(n, 4, dtype=torch.int16) for _ in views]
    masks = [passing.empty(n, dtype=torch.int16) for _ in views]
    keys, spare = ([passing.empty(n, dtype=torch.int64) for _ in views] for _ in range(2))
    counts = [torch.zeros(slices, tiles + columns + 2, dtype=torch.int32) for _ in views]
    project, bin_splats = kernels.project(), kernels.bin_splats()
    lists: dict[int, TileLists] = {}

    def project_range(v: int, s: int) -> None:
        seen = features[v] if features.ndim == 3 else features
        project(
            *ranges[s], width, height, stride, channels,
            views[v], *attributes, seen, splats[v], bounds[v], masks[v], keys[v], counts[v][s],
        )  # fmt: skip

    def fill(v: int) -> None:
        visible = counts[v][:, -1].tolist()
        packed = [keys[v][first : first + some] for (first, _), some in zip(ranges, visible, strict=True)]
        ordered = torch.cat(packed) if slices > 1 else packed[0]
        starts = torch.zeros(tiles + 1, dtype=torch.int64)
        torch.cumsum(counts[v][:, :tiles].sum(dim=0), dim=0, out=starts[1:])
        total = int(starts[-1])
        if total > MOST_ENTRIES:
            raise DynhairError(
                f"{n} Gaussians cover tiles of the image {total} times, more than can be counted",
                mend="render fewer or smaller Gaussians, or a smaller image",
            )
        lists[v] = TileLists(
            splats=splats[v],
            starts=starts.int(),
            entries=workspace.empty(total, dtype=torch.int32),
            reached=workspace.empty(total, dtype=torch.int16),
            ends=torch.empty(tiles, dtype=torch.int32),
        )
        bin_splats(
            width, height, stride, len(ordered),
            splats[v], bounds[v], masks[v], ordered, spare[v], lists[v].starts, lists[v].entries,
            torch.empty_like(lists[v].ends),
        )  # fmt: skip

    run(partial(project_range, v, s) for v in range(len(views)) for s in range(slices))
    run(partial(fill, v) for v in range(len(views)))
    return [lists[v] for v in range(len(views))]
