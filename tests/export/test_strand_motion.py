"""Strands, looks and head mesh of a moving avatar."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from dynhair.avatar import Avatar, HeadMesh, head_pose
from dynhair.avatar.spherical_harmonics import constant_coefficient
from dynhair.editing.edits import Brightness, Thin, Width
from dynhair.errors import DynhairError
from dynhair.export.bound_mesh import BoundMesh
from dynhair.export.colours import mean_colours, point_colours
from dynhair.export.root_uvs import root_uvs
from dynhair.export.strand_motion import MotionFrame, point_taper, strand_motion
from dynhair.strands import root_taper
from tiny_avatars import FRAMES, head_track, make_avatar


@pytest.fixture
def avatar() -> Avatar:
    return make_avatar()


def any_mesh(seed: int = 0) -> HeadMesh:
    generator = torch.Generator().manual_seed(seed)
    vertices = torch.nn.functional.normalize(torch.randn(30, 3, generator=generator), dim=1) * 0.09
    return HeadMesh(vertices, torch.randint(30, (20, 3), generator=generator))


def test_strands_are_those_of_the_posed_avatar(avatar: Avatar) -> None:
    track = head_track()
    motion = strand_motion(avatar, track)
    assert len(motion) == FRAMES
    assert motion.fps == track.fps
    for index, frame in enumerate(motion):
        expected = avatar.pose(track, index).strands.detach().numpy()
        np.testing.assert_allclose(frame.strands, expected, atol=1e-7)  # fused differently where there are gradients
        assert frame.head is None
    np.testing.assert_array_equal(motion.head_transforms[:, :3, :3], track.rotations)
    np.testing.assert_array_equal(motion.head_transforms[:, :3, 3], track.translations)
    np.testing.assert_array_equal(motion.head_transforms[:, 3], [[0, 0, 0, 1]] * FRAMES)


def test_frames_can_be_chosen_and_hair_held_rigid(avatar: Avatar) -> None:
    motion = strand_motion(avatar, head_track(), [3, 1], rigid_hair=True)
    found = [frame.strands for frame in motion]
    expected = [avatar.pose(head_track(), index, rigid_hair=True).strands.detach().numpy() for index in (3, 1)]
    np.testing.assert_allclose(found, expected, atol=1e-7)
    np.testing.assert_array_equal(motion.head_transforms[:, :3, :3], head_track().rotations[[3, 1]])


def test_widths_narrow_towards_the_root_as_those_of_the_segments(avatar: Avatar) -> None:
    points = point_taper(9)
    torch.testing.assert_close((points[1:5] + points[:4]) / 2, root_taper(8)[:4])
    assert points[4:].eq(1).all()
    motion = strand_motion(avatar, head_track())
    np.testing.assert_allclose(motion.widths, np.tile(0.008 * point_taper(8).numpy(), (20, 1)), rtol=1e-6)


def test_colours_are_what_the_harmonics_average_to(avatar: Avatar) -> None:
    np.testing.assert_allclose(
        strand_motion(avatar, head_track()).colours, np.tile([0.4, 0.2, 0.1], (20, 8, 1)), atol=1e-6
    )
    segments = torch.tensor([[0.1, 0.2, 0.3], [0.5, 0.0, 0.3], [2.0, -1.0, 0.3]])
    base = constant_coefficient(torch.cat([segments, segments.flip(0)])).T[None]
    first, second = point_colours(mean_colours(base).unflatten(0, (2, -1)))
    expected = [[0.1, 0.2, 0.3], [0.3, 0.1, 0.3], [0.75, 0, 0.3], [1, 0, 0.3]]
    torch.testing.assert_close(first, torch.tensor(expected))
    torch.testing.assert_close(second, first.flip(0))


def test_root_uvs_do_not_depend_on_size_and_place_and_know_left_and_front() -> None:
    generator = torch.Generator().manual_seed(0)
    roots = torch.nn.functional.normalize(torch.randn(200, 3, generator=generator), dim=1)
    roots[:, 1] = roots[:, 1].abs()
    uv = root_uvs(0.1 * roots + torch.tensor([0.01, 0.02, 0.03]))
    torch.testing.assert_close(uv, root_uvs(roots), atol=1e-4, rtol=0)
    assert ((uv >= 0) & (uv <= 1)).all()
    assert torch.corrcoef(torch.stack([uv[:, 0], roots[:, 0]]))[0, 1] > 0.9
    assert torch.corrcoef(torch.stack([uv[:, 1], roots[:, 2]]))[0, 1] > 0.9
    assert torch.cdist(uv, uv).fill_diagonal_(1).min() > 0


@pytest.mark.parametrize("roots", [[[0.0, 0.1, 0.0]], [[0.0, 0.1, 0.0], [0.1, 0.1, 0.0]], [[0.0, 0.1, 0.0]] * 5])
def test_few_roots_have_uvs_too(roots: list[list[float]]) -> None:
    uv = root_uvs(torch.tensor(roots))
    assert torch.isfinite(uv).all()


def test_the_mesh_rests_where_it_was_bound_and_follows_the_head(avatar: Avatar) -> None:
    skinning, mesh = avatar.head.skinning, any_mesh()
    with torch.no_grad():
        avatar.head.means.add_(0.01)  # what they have learned since is no displacement
        track = head_track(np.tile(skinning.rest_rotation.double().numpy(), (FRAMES, 1, 1)))
        rest = skinning.rest_translation.double().numpy()
        track = replace(
            track,
            translations=np.tile(rest, (FRAMES, 1)),
            expressions=np.tile(avatar.head.modes.rest.numpy(), (FRAMES, 1)),
        )
    frame = strand_motion(avatar, track, mesh=mesh).at(0)
    assert frame.head is not None
    np.testing.assert_allclose(
        frame.head, mesh.vertices @ skinning.rest_rotation.T + skinning.rest_translation, atol=1e-6
    )


def test_a_mesh_whose_gaussians_follow_rigidly_moves_rigidly(avatar: Avatar) -> None:
    assert avatar.head.follow_logits is not None
    torch.nn.init.constant_(avatar.head.follow_logits, 50.0)
    for parameter in avatar.head.deformation.parameters():
        torch.nn.init.zeros_(parameter)
    mesh, motion = any_mesh(), strand_motion(avatar, head_track(), mesh=any_mesh())
    for frame, transform in zip(motion, motion.head_transforms, strict=True):
        assert frame.head is not None
        np.testing.assert_allclose(
            frame.head, mesh.vertices.numpy() @ transform[:3, :3].T + transform[:3, 3], atol=1e-6
        )


def test_vertices_are_displaced_by_the_mean_of_their_gaussians(avatar: Avatar) -> None:
    bound = BoundMesh.to(avatar, any_mesh())
    torch.testing.assert_close(bound.shares.sum(1), torch.ones(30))
    track = head_track()
    motion = strand_motion(avatar, track, mesh=any_mesh())
    posed = avatar.pose(track, 2)
    moved = bound.vertices(head_pose(track, 2), posed.head.means + torch.tensor([0.0, 0.0, 0.5]))
    head = motion.at(2).head
    assert head is not None
    np.testing.assert_allclose(moved.detach().numpy() - [0, 0, 0.5], head, atol=1e-6)


@pytest.mark.parametrize("covered", [False, True])
def test_vertices_have_the_colours_of_the_gaussians_around_them(avatar: Avatar, covered: bool) -> None:
    rows = avatar.scalp.rows
    with torch.no_grad():
        avatar.head.base_colours.copy_(torch.rand(100, 3))
        avatar.scalp.cover_logits.fill_(20.0 if covered else -20.0)
        for parameter in [*avatar.head.colour.parameters(), *avatar.head.attributes.parameters()]:
            parameter.zero_()  # all are as opaque
        bound = BoundMesh.to(avatar, any_mesh())
        colours = avatar.head.base_colours.clone()
        if covered:
            colours[rows] = torch.tensor([0.4, 0.2, 0.1])  # the hair's
    torch.testing.assert_close(bound.colours, (colours[bound.near] * bound.shares[..., None]).sum(1))


def test_frames_that_do_not_fit_the_motion_are_refused(avatar: Avatar) -> None:
    motion = strand_motion(avatar, head_track())
    other = replace(motion, at=lambda _: MotionFrame(np.zeros((3, 8, 3), np.float32)))
    with pytest.raises(DynhairError, match="frame 0 has 3 x 8 points"):
        list(other)
    broken = replace(motion, at=lambda _: MotionFrame(np.full((20, 8, 3), np.nan, np.float32)))
    with pytest.raises(DynhairError, match="frame 0 is not finite"):
        list(broken)
    faceless = replace(motion, at=lambda _: replace(motion.at(0), head=np.zeros((3, 3), np.float32)))
    with pytest.raises(DynhairError, match="without faces"):
        list(faceless)


def test_a_track_of_another_face_model_is_refused(avatar: Avatar) -> None:
    track = replace(head_track(Rotation.identity(FRAMES).as_matrix()), expressions=np.zeros((FRAMES, 7), np.float32))
    with pytest.raises(DynhairError, match="7 expression coefficients"):
        strand_motion(avatar, track)


def test_a_motion_without_frames_is_refused(avatar: Avatar) -> None:
    with pytest.raises(DynhairError, match="no frames"):
        strand_motion(avatar, head_track(), [])


def test_what_is_exported_is_edited(avatar: Avatar) -> None:
    edited = avatar.edited(Brightness(0.5), Thin(0.5), Width(3.0))
    plain, motion = strand_motion(avatar, head_track()), strand_motion(edited, head_track())
    assert 0 < len(motion.ids) < len(plain.ids)
    np.testing.assert_allclose(motion.at(1).strands, plain.at(1).strands[motion.ids], atol=1e-6)
    np.testing.assert_allclose(motion.root_uvs, plain.root_uvs[motion.ids], atol=1e-6)
    np.testing.assert_allclose(motion.colours, plain.colours[motion.ids] / 2, atol=1e-6)
    np.testing.assert_allclose(motion.widths, 3 * plain.widths[motion.ids], rtol=1e-5)
