"""The avatar on a GPU against the same avatar on the CPU, where there is a GPU."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import torch

from tiny_avatars import FRAMES, MOTION_KINDS, SMALL, front_camera, head_track, make_avatar

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")

TRACK = head_track()
CAMERA = front_camera()


@pytest.mark.parametrize("change", MOTION_KINDS, ids=str)
def test_it_is_posed_and_drawn_as_on_the_cpu(change: dict[str, Any]) -> None:
    deformer = replace(SMALL, **change)
    there, here = make_avatar(deformer=deformer).eval().cuda(), make_avatar(deformer=deformer).eval()
    with torch.no_grad():
        for frame in range(FRAMES):
            a, b = there.pose(TRACK, frame), here.pose(TRACK, frame)
            torch.testing.assert_close(a.strands.cpu(), b.strands, atol=1e-5, rtol=0)
            images, expected = there.draw(a, [CAMERA]), here.draw(b, [CAMERA])
            # one pixel in a hundred may differ: a Gaussian at the edge of what is blended may come or go
            difference = (images.rgb.cpu() - expected.rgb).abs()
            assert (difference > 2e-3).double().mean() < 0.01
            torch.testing.assert_close(images.hair.cpu(), expected.hair, atol=2e-2, rtol=0)


@pytest.mark.parametrize("kind", ["paper", "modal", "strands"])
def test_gradients_are_those_of_the_cpu(kind: Any) -> None:
    deformer = replace(SMALL, kind=kind, inextensible=kind != "paper")
    gradients = []
    for device in ("cpu", "cuda"):
        avatar = make_avatar(deformer=deformer).to(device)
        images = avatar.draw(avatar.pose(TRACK, 3), [CAMERA])
        (images.rgb.square().mean() + images.hair.square().mean()).backward()
        gradients.append({name: p.grad.cpu() for name, p in avatar.named_parameters() if p.grad is not None})
    expected, found = gradients
    assert expected.keys() == found.keys()
    for name, gradient in expected.items():
        assert (found[name] - gradient).norm() <= 0.02 * gradient.norm() + 1e-7, name


def test_frozen_gives_the_same() -> None:
    avatar = make_avatar(deformer=replace(SMALL, kind="modal")).eval().cuda()
    frozen = avatar.frozen()
    with torch.no_grad():
        for frame in (0, 3, 1):
            a, b = frozen.pose(TRACK, frame), avatar.pose(TRACK, frame)
            torch.testing.assert_close(a.strands, b.strands, atol=1e-5, rtol=0)
            assert (frozen.draw(a, [CAMERA]).rgb - avatar.draw(b, [CAMERA]).rgb).abs().mean() < 1e-3
