"""The avatar for drawing alone, against the one that is trained."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from dynhair.avatar import Avatar
from dynhair.avatar.branches import Branches
from dynhair.avatar.frozen_layers import FrozenBranches, FrozenLayers
from dynhair.editing import Trim
from dynhair.errors import DynhairError
from dynhair.threads import large_pieces
from tiny_avatars import FRAMES, MOTION_KINDS, SMALL, front_camera, head_track, make_avatar

TRACK = head_track()
METRES, COLOUR = 1e-6, 1e-3  # one in a thousand: a Gaussian at the edge of what is blended may come or go


def assert_same(frozen: Avatar, avatar: Avatar, **pose: bool) -> None:
    """The same strands, head and images in every frame, in an order that uses and outdates what is remembered."""
    camera = front_camera(24)
    for frame in (0, 3, 3, 1):
        with torch.no_grad():
            a, b = frozen.pose(TRACK, frame, **pose), avatar.pose(TRACK, frame, **pose)
        torch.testing.assert_close(a.strands, b.strands, atol=METRES, rtol=0)
        for name in ("means", "scales", "quats", "opacities", "colours"):
            torch.testing.assert_close(getattr(a.head, name), getattr(b.head, name), atol=2e-6, rtol=1e-5)
        with torch.no_grad():
            torch.testing.assert_close(frozen.draw(a, [camera]).rgb, avatar.draw(b, [camera]).rgb, atol=COLOUR, rtol=0)


@pytest.mark.parametrize("threads", [1, 2])
def test_it_draws_the_same_images(threads: int) -> None:
    avatar = make_avatar().eval()
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        with large_pieces():
            assert_same(avatar.frozen(), avatar)
            assert_same(avatar.frozen(), avatar, rigid_hair=True)
    finally:
        torch.set_num_threads(before)


@pytest.mark.parametrize("change", MOTION_KINDS, ids=str)
def test_every_kind_of_hair_motion_stays(change: dict[str, Any]) -> None:
    avatar = make_avatar(deformer=replace(SMALL, **change)).eval()
    assert (avatar.pose(TRACK, 3).strands - avatar.pose(TRACK, 3, rigid_hair=True).strands).abs().max() > 1e-4
    assert_same(avatar.frozen(), avatar)


def test_rigid_hair_and_super_resolution_stay() -> None:
    avatar = make_avatar(super_resolution=2, dynamic=False).eval()
    assert_same(avatar.frozen(), avatar)


def test_edits_and_live_driving_stay() -> None:
    avatar = make_avatar().eval()
    frozen = avatar.edited(Trim(keep=0.5)).frozen()
    assert_same(frozen, avatar.edited(Trim(keep=0.5)))
    assert_same(avatar.frozen().edited(Trim(keep=0.5)), avatar.edited(Trim(keep=0.5)))
    live = avatar.frozen().live()
    late = [live.step(*pose) for pose in zip(TRACK.rotations, TRACK.translations, TRACK.expressions, strict=True)]
    for frame, posed in enumerate([*late[2:], *live.finish()]):
        assert posed is not None
        torch.testing.assert_close(posed.strands, avatar.pose(TRACK, frame).strands, atol=METRES, rtol=0)
    assert len(late) == FRAMES


def test_it_has_no_gradients_and_survives_the_folder(tmp_path: Path) -> None:
    avatar = make_avatar().eval()
    frozen = avatar.frozen()
    assert frozen.frozen() is frozen
    posed = frozen.pose(TRACK, 1)
    assert not posed.strands.requires_grad
    assert not frozen.draw(posed, [front_camera(8)]).rgb.requires_grad
    frozen.save(tmp_path / "a")
    assert_same(Avatar.load(tmp_path / "a"), avatar)


def plain_layers(
    weights: list[torch.Tensor], biases: list[torch.Tensor], given: dict[int, torch.Tensor], x: torch.Tensor
) -> torch.Tensor:
    for index, (weight, bias) in enumerate(zip(weights, biases, strict=True)):
        x = x.double() @ weight.double().T + bias + given.get(index, torch.zeros(1))
        if index + 1 < len(weights):
            x = torch.nn.functional.leaky_relu(x, 0.01)
    return x


@settings(max_examples=20)
@given(
    widths=st.lists(st.integers(1, 64), min_size=1, max_size=4),
    points=st.integers(0, 40),
    seed=st.integers(0, 99),
    givens=st.sets(st.integers(0, 3), max_size=2),
)
def test_layers_of_any_width(widths: list[int], points: int, seed: int, givens: set[int]) -> None:
    random, widths = torch.Generator().manual_seed(seed), [64, *widths]  # so that one kernel does for all
    weights = [torch.randn(b, a, generator=random) / a**0.5 for a, b in pairwise(widths)]
    biases = [torch.randn(b, generator=random) for b in widths[1:]]
    given_rows = {g: torch.randn(points, widths[g + 1], generator=random) for g in sorted(givens) if g < len(weights)}
    x = torch.randn(points, widths[0], generator=random)
    actual = FrozenLayers(weights, given_rows)(biases, x)
    torch.testing.assert_close(actual.double(), plain_layers(weights, biases, given_rows, x), atol=1e-5, rtol=1e-5)


def test_a_layer_may_be_applied_twice() -> None:
    weight, bias, x = torch.randn(3, 3), torch.randn(3), torch.randn(5, 3)
    actual = FrozenLayers([weight, weight])([bias, bias], x)
    expected = plain_layers([weight, weight], [bias, bias], {}, x)
    torch.testing.assert_close(actual.double(), expected, atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("hidden", [(16,), (24, 24), (32, 16, 16, 16, 32)], ids=str)
@pytest.mark.parametrize("bounded", [True, False])
def test_branches_with_and_without_a_skip(hidden: tuple[int, ...], bounded: bool) -> None:
    torch.manual_seed(0)
    branches = Branches(7, 5, 9, hidden, hidden[:2], 3, bounded=bounded)
    for parameter in branches.parameters():
        torch.nn.init.normal_(parameter, std=0.4)
    points, weight = torch.randn(50, 7), torch.rand(50).mul(3).sub(1).clamp(0, 1)
    for weights in (weight, weight.sort().values):  # the points that hear both lie apart, or in one piece
        frozen = FrozenBranches(branches, points, weights)
        for seed in (0, 1, 1, 0):
            random = torch.Generator().manual_seed(seed)
            shared = torch.randn(5, generator=random), torch.randn(9, generator=random)
            with torch.no_grad():
                expected = branches(points, weights, *shared)
            torch.testing.assert_close(frozen(*shared), expected, atol=1e-5, rtol=1e-5)


def test_layers_that_do_not_fit_are_refused() -> None:
    layers = FrozenLayers([torch.zeros(8, 4), torch.zeros(2, 8)])
    with pytest.raises(DynhairError, match="points"):
        layers([torch.zeros(8), torch.zeros(2)], torch.zeros(3, 5))
    with pytest.raises(DynhairError, match="biases"):
        layers([torch.zeros(7), torch.zeros(2)], torch.zeros(3, 4))
    with pytest.raises(DynhairError, match="given"):
        FrozenLayers([torch.zeros(8, 4)], {0: torch.zeros(3, 7)})
    with pytest.raises(DynhairError, match="weights"):
        FrozenLayers([torch.zeros(8, 4), torch.zeros(2, 9)])
    with pytest.raises(DynhairError, match="3 layers"):
        FrozenLayers([torch.zeros(1, 1)] * 3, {layer: torch.zeros(2, 1) for layer in range(3)})


def test_conditions_are_worked_out_once_a_track(monkeypatch: pytest.MonkeyPatch) -> None:
    frozen, asked = make_avatar().eval().frozen(), []
    forward = frozen.normalizer.forward
    monkeypatch.setattr(frozen.normalizer, "forward", lambda signals: asked.append(0) or forward(signals))
    first = [frozen.pose(TRACK, frame).strands for frame in range(FRAMES)]
    assert len(asked) == 1
    other = replace(TRACK, gravity=np.array([9.81, 0.0, 0.0]))
    assert (frozen.pose(other, 2).strands - first[2]).abs().max() > 1e-5
    assert torch.equal(frozen.pose(TRACK, 2).strands, first[2])


@pytest.mark.parametrize("threads", [1, 2])
def test_what_is_remembered_serves_in_every_mode(threads: int) -> None:
    avatar, camera = make_avatar().eval(), front_camera(16)
    frozen, before = avatar.frozen(), torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        with torch.inference_mode():
            first = frozen.draw(frozen.pose(TRACK, 2), [camera]).rgb
        again = frozen.draw(frozen.pose(TRACK, 2), [camera]).rgb
        with torch.inference_mode():
            assert torch.equal(frozen.draw(frozen.pose(TRACK, 2), [camera]).rgb, again)
    finally:
        torch.set_num_threads(before)
    assert torch.equal(first, again)
