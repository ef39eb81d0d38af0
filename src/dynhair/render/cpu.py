"""The rasterizer on the CPU: projection, depth sort, tile lists and blending in compiled kernels.

Each step's work is cut into independent pieces: one for each view and, where there are fewer views than threads, one
for each of several ranges of a view. Sums are taken in a fixed order, so that with the same number of threads the same
input gives the same bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from dynhair.camera import Camera
from dynhair.errors import DynhairError
from dynhair.render import kernels
from dynhair.render.gaussians import Gaussians, Rendering
from dynhair.render.parallel import share, share_tiles, slices_per_view
from dynhair.render.tiling import TileLists, feature_room, list_splats, pack_camera
from dynhair.render.workspace import Workspace
from dynhair.threads import run, thread_count

CHANNELS_AT_ONCE = 32  # a wider blend would outgrow the registers and the stack of a thread


def rasterize_cpu(gaussians: Gaussians, cameras: Sequence[Camera]) -> Rendering:
    """Render over black in float32; see :func:`dynhair.render.rasterize`."""
    attributes = [gaussians.means, gaussians.quats, gaussians.scales, gaussians.opacities]
    if any(tensor.device.type != "cpu" for tensor in [*attributes, gaussians.features]):
        raise DynhairError("the CPU rasterizer was given tensors of another device", mend="pass backend='auto'")
    attributes = [tensor.float().contiguous() for tensor in attributes]
    views = torch.stack([pack_camera(camera) for camera in cameras])

    def draw(features: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        return _Rasterize.apply(*attributes, features.contiguous(), views, cameras[0].width, cameras[0].height)

    features = gaussians.features.float()
    if features.shape[-1] <= CHANNELS_AT_ONCE:
        return Rendering(*draw(features))
    parts = [draw(some) for some in features.split(CHANNELS_AT_ONCE, dim=-1)]
    return Rendering(torch.cat([image for image, _, _ in parts], dim=-1), parts[0][1], parts[0][2])


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
        channels, room = features.shape[-1], feature_room(features.shape[-1])
        workspace = Workspace()
        all_lists = list_splats(workspace, (means, quats, scales, opacities), features, views, width, height)

        image = torch.empty(len(views), height, width, channels)
        alpha, depth = torch.empty(len(views), height, width), torch.empty(len(views), height, width)
        blend = kernels.blend(room)
        run(
            lambda v=v, lists=lists, first=first, last=last: blend(
                first, last, width, height, channels, *lists.tensors, image[v], alpha[v], depth[v]
            )
            for v, lists in enumerate(all_lists)
            for first, last in share_tiles(lists.starts, slices_per_view(len(views)))
        )
        ctx.size, ctx.workspace = (width, height), workspace
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
        all_lists = [TileLists(*fields[start : start + 5]) for start in range(0, len(fields), 5)]
        grad_image, grad_alpha, grad_depth = (gradient.float().contiguous() for gradient in gradients)
        width, height = ctx.size
        channels, slices = features.shape[-1], slices_per_view(len(views))

        workspace = Workspace()
        splat_grads = [workspace.zeros(slices, *lists.splats.shape) for lists in all_lists]
        blend_backward = kernels.blend_backward(feature_room(features.shape[-1]))
        run(
            lambda v=v, s=s, lists=lists, first=first, last=last: blend_backward(
                first, last, width, height, channels, *lists.tensors, image[v], alpha[v], depth[v],
                grad_image[v], grad_alpha[v], grad_depth[v], splat_grads[v][s],
            )
            for v, lists in enumerate(all_lists)
            for s, (first, last) in enumerate(share_tiles(lists.starts, slices))
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

        run(partial(gather_range, first, last) for first, last in share(n, thread_count()))
        return (*grads, None, None, None)
