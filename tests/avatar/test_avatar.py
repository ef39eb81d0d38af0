"""The avatar as a whole: posing, drawing, storing."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from dynhair.avatar import Avatar, StrandDeformer, head_pose
from dynhair.avatar.spherical_harmonics import harmonics_colours
from dynhair.camera import Camera
from dynhair.capture import ExpressionBasis
from dynhair.errors import DynhairError
from dynhair.motion import SignalNormalizer, motion_signals
from dynhair.strands import segment_lengths
from tiny_avatars import FRAMES, SMALL, front_camera, head_track, make_avatar


@pytest.fixture
def avatar() -> Avatar:
    return make_avatar()


def test_moving_hair_differs_from_rigid_hair_and_both_follow_the_head(avatar: Avatar) -> None:
    track = head_track()
    pose = head_pose(track, 3)
    rigid = avatar.pose(track, 3, rigid_hair=True).strands
    torch.testing.assert_close(rigid, avatar.canonical_strands @ pose.rotation.T + pose.translation)
    moving = avatar.pose(track, 3).strands
    expected = avatar.deformed_strands(track, [3])[0] @ pose.rotation.T + pose.translation
    torch.testing.assert_close(moving, expected)
    assert (moving - rigid).abs().max() > 1e-4


def test_images_show_labels_background_and_hair_direction(avatar: Avatar) -> None:
    images = avatar.draw(avatar.pose(head_track(), 0), [front_camera(), front_camera()])
    assert images.rgb.shape == (2, 40, 40, 3)
    torch.testing.assert_close(images.rgb[0, 0, 0], avatar.background)
    torch.testing.assert_close(images.hair + images.body, images.alpha)
    assert torch.equal(images.rgb[0], images.rgb[1])
    seen = images.hair[0] > 0.5
    assert seen.any()
    down = (images.orientation[0][seen] - 0.5).abs()
    assert down.median() < 0.1


def test_drawing_is_differentiable_in_every_parameter(avatar: Avatar) -> None:
    images = avatar.draw(avatar.pose(head_track(), 2), [front_camera()])
    (images.rgb.square().sum() + images.direction.square().sum() + images.hair.sum()).backward()
    for name, parameter in avatar.named_parameters():
        assert parameter.grad is not None, name
        assert torch.isfinite(parameter.grad).all(), name


def test_turning_everything_with_the_camera_changes_no_label(avatar: Avatar) -> None:
    assert avatar.head.follow_logits is not None
    torch.nn.init.constant_(avatar.head.follow_logits, 50.0)  # no body that would stay behind
    turn = Rotation.from_euler("y", 0.7).as_matrix()
    still = np.tile(np.eye(3), (FRAMES, 1, 1))
    plain, turned = head_track(still), head_track(turn @ still)
    camera = front_camera()
    moved = torch.from_numpy(turn).float()
    shift = torch.tensor([0.0, 0.7, 0.0])
    # turn the camera about the head's centre together with the head
    rotation = camera.w2c[:, :3] @ moved.T
    offset = camera.w2c[:, 3] + camera.w2c[:, :3] @ shift - rotation @ shift
    other = Camera(torch.cat([rotation, offset[:, None]], 1), camera.K, camera.width, camera.height)
    a = avatar.draw(avatar.pose(plain, 0, rigid_hair=True), [camera])
    b = avatar.draw(avatar.pose(turned, 0, rigid_hair=True), [other])
    torch.testing.assert_close(a.hair, b.hair, atol=2e-2, rtol=0)


def test_an_avatar_survives_its_folder(avatar: Avatar, tmp_path: Path) -> None:
    track = head_track()
    expected = avatar.eval().draw(avatar.pose(track, 2), [front_camera()])
    avatar.save(tmp_path / "a")
    loaded = Avatar.load(tmp_path / "a")
    actual = loaded.draw(loaded.pose(track, 2), [front_camera()])
    assert torch.equal(actual.rgb, expected.rgb)
    assert loaded.hair.width == avatar.hair.width
    avatar.save(tmp_path / "a")
    assert sorted(p.name for p in (tmp_path / "a").iterdir()) == ["avatar.json", "avatar.safetensors"]


@pytest.mark.parametrize(
    "change",
    [
        {"signals": "pose"},
        {"signals": "pose", "gravity": False},
        {"acceleration": False},
        {"gravity": False},
        {"encoder": "mlp"},
        {"film": False},
        {"knots": 3},
        {"inextensible": True},
        {"kind": "strands", "history": 12, "guides": 5, "turn": True},
    ],
    ids=str,
)
def test_every_kind_of_hair_motion_survives_the_folder(change: dict[str, Any], tmp_path: Path) -> None:
    avatar, track = make_avatar(deformer=replace(SMALL, **change)).eval(), head_track()
    avatar.normalizer = SignalNormalizer.fit([motion_signals(track)], avatar.hair.deformer.config)
    avatar.save(tmp_path / "a")
    loaded = Avatar.load(tmp_path / "a")
    strands = avatar.deformed_strands(track, [0, 3])
    assert torch.equal(loaded.deformed_strands(track, [0, 3]), strands)
    assert (strands - avatar.canonical_strands).abs().max() > 1e-4
    assert loaded.hair.deformer.config == avatar.hair.deformer.config


def test_dynamics_know_the_frame_rate_of_the_recording(tmp_path: Path) -> None:
    trained = make_avatar(deformer=replace(SMALL, kind="strands", guides=5))
    assert trained.recording is not None
    trained.recording = replace(trained.recording, fps=25.0)
    trained.save(tmp_path / "a")
    deformer = Avatar.load(tmp_path / "a").hair.deformer
    assert isinstance(deformer, StrandDeformer)
    assert deformer.pace == pytest.approx(1.2)


@pytest.mark.parametrize(
    ("change", "blind_to"),
    [
        ({}, {"translations"}),
        ({"acceleration": False}, {"translations"}),
        ({"gravity": False}, {"translations", "gravity"}),
        ({"signals": "pose"}, {"fps"}),
        ({"signals": "pose", "gravity": False}, {"fps", "gravity"}),
    ],
    ids=str,
)
def test_hair_depends_on_the_chosen_signals_alone(change: dict[str, Any], blind_to: set[str]) -> None:
    track = head_track()
    others = {
        "fps": replace(track, fps=25.0),  # the same poses at other velocities
        "gravity": replace(track, gravity=np.array([9.81, 0, 0.0])),
        "translations": replace(track, translations=track.translations + np.arange(FRAMES)[:, None]),
    }
    avatar = make_avatar(deformer=replace(SMALL, **change)).eval()
    avatar.normalizer = SignalNormalizer.fit([motion_signals(others["fps"])], avatar.hair.deformer.config)
    strands = avatar.deformed_strands(track, [3])
    blind = {name for name, other in others.items() if torch.equal(avatar.deformed_strands(other, [3]), strands)}
    assert blind == blind_to


def test_hair_that_cannot_stretch_bends_from_roots_that_stay() -> None:
    avatar = make_avatar(deformer=replace(SMALL, inextensible=True)).eval()
    moved, rest = avatar.deformed_strands(head_track(), [3])[0], avatar.canonical_strands
    torch.testing.assert_close(segment_lengths(moved), segment_lengths(rest))
    assert torch.equal(moved[:, 0], rest[:, 0])
    with torch.no_grad():
        avatar.hair.deformer.config = SMALL
        stretching = avatar.deformed_strands(head_track(), [3])[0]
    steps = [torch.nn.functional.normalize(strands.diff(dim=1), dim=-1) for strands in (moved, stretching)]
    torch.testing.assert_close(*steps)
    assert (segment_lengths(stretching) - segment_lengths(rest)).abs().max() > 1e-4


def test_rigid_hair_has_no_network_and_survives_the_folder(tmp_path: Path) -> None:
    avatar, track = make_avatar(dynamic=False).eval(), head_track()
    assert not list(avatar.hair.deformer.parameters())
    assert torch.equal(avatar.pose(track, 3).strands, avatar.pose(track, 3, rigid_hair=True).strands)
    avatar.save(tmp_path / "a")
    loaded = Avatar.load(tmp_path / "a")
    assert torch.equal(loaded.deformed_strands(track, [1, 4]), avatar.canonical_strands.expand(2, -1, -1, -1))
    assert not list(loaded.hair.deformer.parameters())


def test_a_folder_that_says_nothing_of_the_hair_motion_has_the_papers(avatar: Avatar, tmp_path: Path) -> None:
    avatar.save(tmp_path / "a")
    path = tmp_path / "a" / "avatar.json"
    description = json.loads(path.read_text())
    del description["dynamic"]
    description["deformer"] = {name: description["deformer"][name] for name in ("history", "hidden", "width")}
    path.write_text(json.dumps(description))
    loaded = Avatar.load(tmp_path / "a")
    assert loaded.hair.deformer.config == SMALL
    assert torch.equal(loaded.deformed_strands(head_track(), [2]), avatar.deformed_strands(head_track(), [2]))


def test_damaged_avatars_are_named(avatar: Avatar, tmp_path: Path) -> None:
    def damaged(name: str, change) -> None:
        avatar.save(tmp_path / "a")
        change(tmp_path / "a" / name)
        with pytest.raises(DynhairError) as caught:
            Avatar.load(tmp_path / "a")
        assert name in str(caught.value)

    damaged("avatar.json", lambda p: p.unlink())
    damaged("avatar.json", lambda p: p.write_text(json.dumps({"kind": "dynhair avatar", "version": 99})))
    damaged("avatar.safetensors", lambda p: p.unlink())
    damaged("avatar.safetensors", lambda p: p.write_bytes(p.read_bytes()[:-10]))
    damaged("avatar.safetensors", lambda p: p.write_bytes(b"\x80\x04pickle"))

    def rewrite(path: Path) -> None:
        description = json.loads(path.with_name("avatar.json").read_text())
        description["expression_size"] = 7
        path.with_name("avatar.json").write_text(json.dumps(description))

    damaged("avatar.safetensors", rewrite)
    with pytest.raises(DynhairError, match="no such folder"):
        Avatar.load(tmp_path / "none")


def test_expressions_of_another_face_model_are_refused(avatar: Avatar) -> None:
    track = replace(head_track(), expressions=np.zeros((FRAMES, 3), np.float32))
    with pytest.raises(DynhairError, match="3 expression coefficients"):
        avatar.pose(track, 0)


def test_an_avatar_says_whose_expressions_it_knows(tmp_path: Path) -> None:
    avatar = make_avatar(basis=ExpressionBasis("open", ("jaw", "smile", "blink", "brow")))
    avatar.save(tmp_path / "a")
    loaded = Avatar.load(tmp_path / "a")
    assert loaded.expression_basis == avatar.expression_basis
    loaded.pose(head_track(), 0)  # a track that does not tell is taken at its size
    loaded.pose(replace(head_track(), expression_basis=ExpressionBasis("open")), 0)
    with pytest.raises(DynhairError, match="of the face model 'BFM 2009'"):
        loaded.pose(replace(head_track(), expression_basis=ExpressionBasis("BFM 2009")), 0)


def test_scalp_that_counts_as_hair_is_labelled_and_coloured_as_hair(avatar: Avatar) -> None:
    posed = avatar.pose(head_track(), 0)
    camera = front_camera()
    with torch.no_grad():
        before = avatar.draw(posed, [camera])
        avatar.scalp.cover_logits.fill_(20.0)
        after = avatar.draw(posed, [camera])
        avatar.scalp.cover_logits.fill_(-20.0)
        bare = avatar.draw(posed, [camera])
    torch.testing.assert_close(after.alpha, before.alpha)
    torch.testing.assert_close(after.hair + after.body, after.alpha)
    more = after.hair[0] - bare.hair[0]
    assert more.min() > -1e-5
    assert more.max() > 0.5
    there = more > 0.9 * after.alpha[0]  # pixels of the layer alone, but for a tenth
    assert there.any()
    hair = avatar.hair  # of the same colour from everywhere
    colour = harmonics_colours(hair.base_harmonic, hair.higher_harmonics, torch.eye(3)[:1].expand(1, 20 * 7, 3))[0, 0]
    alpha = after.alpha[0][there][:, None]
    expected = alpha * colour + (1 - alpha) * avatar.background
    torch.testing.assert_close(after.rgb[0][there], expected, atol=0.1, rtol=0)


def test_super_resolution_enlarges_what_is_drawn() -> None:
    plain, larger = make_avatar(), make_avatar(super_resolution=2)
    large = front_camera(40)
    images = larger.draw(larger.pose(head_track(), 1, rigid_hair=True), [large])
    assert images.rgb.shape == (1, 40, 40, 3)
    assert images.hair.shape == images.body.shape == images.alpha.shape == (1, 40, 40)
    assert images.direction.shape == (1, 40, 40, 2)
    assert images.coarse is not None
    drawn = plain.draw(plain.pose(head_track(), 1, rigid_hair=True), [large.resized(20, 20)])
    assert drawn.coarse is None
    torch.testing.assert_close(images.coarse, drawn.rgb, atol=0.05, rtol=0)
    pooled = torch.nn.functional.avg_pool2d(images.hair[None], 2)[0]
    torch.testing.assert_close(pooled, drawn.hair, atol=0.3, rtol=0)
    images.rgb.sum().backward()
    assert larger.super_resolution is not None
    for name, parameter in larger.super_resolution.named_parameters():
        assert parameter.grad is not None, name
    with pytest.raises(DynhairError, match="41 x 41"):
        larger.draw(larger.pose(head_track(), 1), [front_camera(41)])


def test_super_resolution_survives_the_folder(tmp_path: Path) -> None:
    avatar = make_avatar(super_resolution=4)
    avatar.save(tmp_path / "a")
    loaded = Avatar.load(tmp_path / "a")
    a, b = (x.draw(x.pose(head_track(), 1), [front_camera()]) for x in (avatar.eval(), loaded))
    assert torch.equal(a.rgb, b.rgb)
