"""The rasterizer on the CPU: projection, depth sort, tile lists and blending in compiled kernels.

Each step's work is cut into independent pieces: one for each view and, where there are fewer views than threads, one
for each of several ranges of a view. Sums are taken in a fixed order, so that with the same number of threads the same
input gives the same bits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from dynhair.camera import Camera
from dynhair.errors import DynhairError
from dynhair.render import kernels
from dynhair.render.gaussians import Gaussians, Rendering
from dynhair.render.kernels import SPLAT_HEADER, TILE

CHANNELS_AT_ONCE = 32  # a wider blend would outgrow the registers and the stack of a thread
CHANNEL_STEP = 4  # blending kernels are compiled for multiples of this
FIELD_OF_VIEW_MARGIN = 0.3
TILE_COST = 32  # of an empty tile, in list entries, where tiles are shared out among threads
MOST_ENTRIES = 2**31 - 1


def rasterize_cpu(gaussians: Gaussians, cameras: Sequence[Camera]) -> Rendering:
    """Render over black in float32; see :func:`dynhair.render.rasterize`."""
    attributes = [gaussians.means, gaussians.quats, gaussians.scales, gaussians.opacities]
    if any(tensor.device.type != "cpu" for tensor in [*attributes, gaussians.features]):
        raise DynhairError("the CPU rasterizer was given tensors of another device", mend="pass backend='auto'")
    attributes = [tensor.float().contiguous() for tensor in attributes]
    views = torch.stack([_pack(camera) for camera in cameras])
    parts = [
        _Rasterize.apply(*attributes, features.contiguous(), views, cameras[0].width, cameras[0].height)
        for features in gaussians.features.float().split(CHANNELS_AT_ONCE, dim=-1)
    ]
    images = [image for image, _, _ in parts]
    return Rendering(images[0] if len(images) == 1 else torch.cat(images, dim=-1), parts[0][1], parts[0][2])


def _pack(camera: Camera) -> Tensor:
    """Lay out w2c, fx, fy, cx, cy, and the slopes that the Jacobian is held between, as the kernels want them."""
    camera = camera.to("cpu", torch.float64)
    focal, centre = camera.K.diagonal()[:2], camera.K[:2, 2]
    size = torch.tensor([camera.width, camera.height], dtype=torch.float64)
    margin = FIELD_OF_VIEW_MARGIN * size / 2 / focal
    slopes = torch.stack([-centre / focal - margin, (size - centre) / focal + margin], dim=1)
    return torch.cat([camera.w2c.reshape(-1), focal, centre, slopes.reshape(-1)]).detach().float()


@dataclass(frozen=True)
class _Lists:
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


class _Rasterize(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        means: Tensor,
        quats: Tensor,
        scales: Tensor,
        opacities: Tensor,
        features: Tensor,
        views: Tensor,
        width: int,
        height: int,
    ) -> tuple[Tensor, Tensor, Tensor]:
        channels, room = features.shape[-1], _room(features)
        all_lists = _list_splats((means, quats, scales, opacities), features, views, width, height)

        image = torch.empty(len(views), height, width, channels)
        alpha, depth = torch.empty(len(views), height, width), torch.empty(len(views), height, width)
        blend = kernels.blend(room)
        _run(
            lambda v=v, lists=lists, first=first, last=last: blend(
                first, last, width, height, channels, *lists.tensors, image[v], alpha[v], depth[v]
            )
            for v, lists in enumerate(all_lists)
            for first, last in _share_tiles(lists.starts, _slices(views))
        )
        ctx.size = width, height
        ctx.save_for_backward(
            means, quats, scales, opacities, features, views, image, alpha, depth,
            *(tensor for lists in all_lists for tensor in lists.tensors),
        )  # fmt: skip
        return image, alpha, depth

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:  # pyright: ignore[reportIncompatibleMethodOverride]
        *attributes, features, views, image, alpha, depth = ctx.saved_tensors[:9]
        fields = ctx.saved_tensors[9:]
        all_lists = [_Lists(*fields[start : start + 5]) for start in range(0, len(fields), 5)]
        grad_image, grad_alpha, grad_depth = (gradient.float().contiguous() for gradient in gradients)
        width, height = ctx.size
        channels, slices = features.shape[-1], _slices(views)

        splat_grads = [torch.zeros(slices, *lists.splats.shape) for lists in all_lists]
        blend_backward = kernels.blend_backward(_room(features))
        _run(
            lambda v=v, s=s, lists=lists, first=first, last=last: blend_backward(
                first, last, width, height, channels, *lists.tensors, image[v], alpha[v], depth[v],
                grad_image[v], grad_alpha[v], grad_depth[v], splat_grads[v][s],
            )
            for v, lists in enumerate(all_lists)
            for s, (first, last) in enumerate(_share_tiles(lists.starts, slices))
        )  # fmt: skip

        grads = [torch.empty_like(tensor) for tensor in (*attributes, features)]
        n, stride = splat_grads[0].shape[1:]
        project_backward = kernels.project_backward()

        def gather_range(first: int, last: int) -> None:
            for v, view in enumerate(views):
                per_view = features.ndim == 3
                of_features = grads[-1][v] if per_view else grads[-1]
                project_backward(
                    first, last, n, stride, channels, slices, v > 0, v > 0 and not per_view,
                    view, *attributes, splat_grads[v], *grads[:-1], of_features,
                )  # fmt: skip

        _run(partial(gather_range, first, last) for first, last in _share(n, torch.get_num_threads()))
        return (*grads, None, None, None)


def _list_splats(
    attributes: Sequence[Tensor], features: Tensor, views: Tensor, width: int, height: int
) -> list[_Lists]:
    """Project the Gaussians into each view, sorts them by depth and lists them by tile."""
    n, channels, slices = len(attributes[0]), features.shape[-1], _slices(views)
    stride = SPLAT_HEADER + _room(features)
    tiles = -(-width // TILE) * -(-height // TILE)
    ranges = _share(n, slices)
    splats = [torch.empty(n, stride) for _ in views]
    bounds = [torch.empty(n, 4, dtype=torch.int16) for _ in views]
    masks = [torch.empty(n, dtype=torch.int16) for _ in views]
    keys = [torch.empty(n, dtype=torch.int64) for _ in views]
    counts = [torch.zeros(slices, tiles + 1, dtype=torch.int32) for _ in views]

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
        torch.cumsum(counts[v][:, :-1].sum(dim=0), dim=0, out=starts[1:])
        total = int(starts[-1])
        if total > MOST_ENTRIES:
            raise DynhairError(
                f"{n} Gaussians cover tiles of the image {total} times, more than can be counted",
                mend="render fewer or smaller Gaussians, or a smaller image",
            )
        entries = torch.empty(total, dtype=torch.int32)
        lists[v] = _Lists(
            splats[v],
            starts.int(),
            entries,
            torch.empty(total, dtype=torch.int16),
            torch.empty(tiles, dtype=torch.int32),
        )
        bin_splats(
            width, height, stride, len(ordered),
            splats[v], bounds[v], masks[v], ordered, torch.empty_like(ordered), lists[v].starts, entries,
            torch.empty_like(lists[v].ends),
        )  # fmt: skip

    project, bin_splats = kernels.project(), kernels.bin_splats()
    lists: dict[int, _Lists] = {}
    _run(partial(project_range, v, s) for v in range(len(views)) for s in range(slices))
    _run(partial(fill, v) for v in range(len(views)))
    return [lists[v] for v in range(len(views))]


def _room(features: Tensor) -> int:
    """Feature channels of a splat: rounded up to what blending kernels are compiled for."""
    return -(-features.shape[-1] // CHANNEL_STEP) * CHANNEL_STEP


def _slices(views: Tensor) -> int:
    """Into how many ranges each view is cut to keep all threads busy."""
    return max(1, torch.get_num_threads() // len(views))


def _share(count: int, parts: int) -> list[tuple[int, int]]:
    """Cut ``range(count)`` into contiguous ranges of about the same length."""
    return list(pairwise(count * part // parts for part in range(parts + 1)))


def _share_tiles(starts: Tensor, parts: int) -> list[tuple[int, int]]:
    """Cut a view's tiles into contiguous ranges of about the same work."""
    if parts == 1:
        return [(0, len(starts) - 1)]
    work = starts + TILE_COST * torch.arange(len(starts), dtype=torch.int32)
    cuts = torch.searchsorted(work, work[-1] * torch.arange(1, parts) // parts).tolist()
    return list(pairwise([0, *cuts, len(starts) - 1]))


def _run(tasks: Iterable[Callable[[], None]]) -> None:
    """Run tasks on as many threads as PyTorch uses."""
    tasks = list(tasks)
    workers = min(torch.get_num_threads(), len(tasks))
    if workers == 1:
        for task in tasks:
            task()
        return
    with ThreadPoolExecutor(workers) as pool:  # not kept: its threads would not survive a fork
        for done in [pool.submit(task) for task in tasks]:
            done.result()
