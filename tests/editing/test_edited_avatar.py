"""Avatars whose hair is edited: posed, drawn, stored."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

from dynhair.avatar import Avatar, head_pose
from dynhair.editing import Brightness, Edit, Thin, Tint, Trim, Width
from dynhair.errors import DynhairError
from tiny_avatars import front_camera, head_track, make_avatar

EDITS = (Brightness(0.7), Tint("#c02020", region="left"), Trim(0.6, region="ids:3-12"), Thin(0.5), Width(2.0))


@pytest.fixture(scope="module")
def avatar() -> Avatar:
    made = make_avatar().eval()
    with torch.no_grad():
        made.scalp.cover_logits.fill_(3.0)
        generator = torch.Generator().manual_seed(0)
        for harmonics in (made.hair.base_harmonic, made.hair.higher_harmonics):
            harmonics.add_(0.2 * torch.randn(harmonics.shape, generator=generator))
    return made


def images(avatar: Avatar, frame: int = 3) -> list[torch.Tensor]:
    with torch.no_grad():
        drawn = avatar.draw(avatar.pose(head_track(), frame), [front_camera()])
    return [drawn.rgb, drawn.hair, drawn.body, drawn.direction, drawn.alpha]


def test_edits_change_images_and_taking_them_back_restores_every_bit(avatar: Avatar) -> None:
    before = images(avatar)
    edited = avatar
    for edit in EDITS:
        previous, edited = edited, edited.edited(edit)
        assert not torch.equal(images(edited)[0], images(previous)[0]), edit
        assert all(map(torch.equal, images(previous.edited(edit).with_edits(previous.edits)), images(previous)))
    assert edited.edits == EDITS
    assert all(map(torch.equal, images(edited.with_edits(())), before))
    assert all(map(torch.equal, images(avatar), before))  # and the avatar itself was never changed
    assert avatar.edits == ()


def test_an_edited_avatar_shares_its_tensors(avatar: Avatar) -> None:
    edited = avatar.edited(*EDITS)
    mine, others = dict(avatar.named_parameters()), dict(edited.named_parameters())
    assert mine.keys() == others.keys()
    assert all(mine[name] is others[name] for name in mine)
    assert edited.state_dict().keys() == avatar.state_dict().keys()


@pytest.mark.parametrize("frame", [0, 2, 4])
def test_an_edit_is_of_the_same_strands_in_every_frame(avatar: Avatar, frame: int) -> None:
    edited = avatar.edited(Trim(0.5, region="ids:2,7"), Brightness(0.5, region="ids:4"), Width(3.0, region="ids:5"))
    plain, posed = avatar.pose(head_track(), frame), edited.pose(head_track(), frame)
    moved = (plain.strands != posed.strands).flatten(1).any(1)
    assert moved.nonzero()[:, 0].tolist() == [2, 7]
    # at rest segments are equally long: half of a strand has its points, and in the middle between every two
    whole = plain.strands[moved]
    between = torch.stack([whole[:, :-1], (whole[:, :-1] + whole[:, 1:]) / 2], 2).flatten(1, 2)
    torch.testing.assert_close(posed.strands[moved], between[:, :8], atol=1e-6, rtol=0)
    recoloured = (plain.hair.base_harmonic != posed.hair.base_harmonic).view(3, 20, 7).any(2).any(0)
    assert recoloured.nonzero()[:, 0].tolist() == [2, 4, 7]  # colours move along a strand that is cut
    assert (plain.hair.widths != posed.hair.widths).nonzero()[:, 0].tolist() == [5]


def test_thinned_hair_is_the_same_strands_in_every_frame(avatar: Avatar) -> None:
    edited = avatar.edited(Thin(0.4))
    ids = edited.pose(head_track(), 0).hair.ids
    assert len(ids) == 8
    for frame in range(5):
        posed = edited.pose(head_track(), frame)
        assert torch.equal(posed.hair.ids, ids)
        assert torch.equal(posed.strands, avatar.pose(head_track(), frame).strands[ids])


def test_edits_work_on_strands_from_elsewhere(avatar: Avatar) -> None:
    edited = avatar.edited(Trim(0.5), Thin(0.5))
    pose = head_pose(head_track(), 1)
    simulated = torch.rand(20, 8, 3)
    posed = edited.with_strands(simulated, avatar.head(pose))
    torch.testing.assert_close(posed.strands[:, 0], simulated[posed.hair.ids, 0])
    assert posed.strands.shape == (10, 8, 3)


def test_the_scalp_takes_the_colour_of_edited_hair(avatar: Avatar) -> None:
    def scalp(avatar: Avatar) -> torch.Tensor:
        with torch.no_grad():
            posed = avatar.pose(head_track(), 0)
            look = posed.hair
            colours = 0.5 + look.base_harmonic.mT / (4 * torch.pi) ** 0.5
            return avatar.scalp(colours, look).colours

    torch.testing.assert_close(scalp(avatar.edited(Brightness(0.5))), 0.5 * scalp(avatar))
    thinned = scalp(avatar.edited(Thin(0.05)))  # one strand is left, and colours all of it
    torch.testing.assert_close(thinned, thinned[:, :1].expand_as(thinned))


def test_brightness_darkens_hair_and_nothing_else(avatar: Avatar) -> None:
    dark = avatar.edited(Brightness(1e-6))
    rgb, hair, body, _, alpha = images(dark)
    plain_rgb, plain_hair, *_ = images(avatar)
    assert torch.equal(hair, plain_hair)
    bare = hair < 1e-6
    assert torch.equal(rgb[bare], plain_rgb[bare])
    alone = (hair > 0.999 * alpha) & (alpha > 0.5)
    assert alone.any()
    through = (1 - alpha)[..., None] * dark.background
    torch.testing.assert_close(rgb[alone], through[alone].clone(), atol=2e-3, rtol=0)
    assert (body >= 0).all()


def test_gradients_reach_the_motion_of_edited_hair() -> None:
    avatar = make_avatar()
    avatar.edited(*EDITS).pose(head_track(), 3).strands.square().sum().backward()
    assert avatar.hair.strands.grad is not None
    assert avatar.hair.strands.grad.any()


def test_edits_are_worked_out_again_in_another_precision() -> None:
    edited = make_avatar().eval().edited(Brightness(0.5))
    head = edited.pose(head_track(), 0).head
    edited.hair.double()
    assert edited.with_strands(edited.canonical_strands, head).hair.base_harmonic.dtype == torch.float64


def test_edits_made_in_inference_mode_serve_training_too() -> None:
    avatar = make_avatar()
    with torch.inference_mode():
        edited = avatar.edited(Width(2.0), Trim(0.5))
    images = edited.draw(edited.pose(head_track(), 1), [front_camera()])
    images.rgb.sum().backward()


def test_edits_survive_the_folder(avatar: Avatar, tmp_path: Path) -> None:
    edited = avatar.edited(*EDITS)
    edited.save(tmp_path / "a")
    loaded = Avatar.load(tmp_path / "a")
    assert loaded.edits == EDITS
    assert all(map(torch.equal, images(loaded), images(edited)))
    assert all(map(torch.equal, images(loaded.with_edits(())), images(avatar)))


def test_an_avatar_from_before_there_were_edits_has_none(avatar: Avatar, tmp_path: Path) -> None:
    avatar.save(tmp_path / "a")
    path = tmp_path / "a" / "avatar.json"
    description = json.loads(path.read_text())
    del description["edits"]
    path.write_text(json.dumps(description))
    assert Avatar.load(tmp_path / "a").edits == ()


@pytest.mark.parametrize("edits", [[{"edit": "perm"}], {"edit": "width"}, [{"edit": "width", "factor": "wide"}], 3])
def test_damaged_edits_are_refused(avatar: Avatar, edits: object, tmp_path: Path) -> None:
    avatar.save(tmp_path / "a")
    path = tmp_path / "a" / "avatar.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "edits": edits}))
    with pytest.raises(DynhairError):
        Avatar.load(tmp_path / "a")


@pytest.mark.parametrize("edit", [Width(2.0, region="ids:20"), Trim(0.5, region="sphere:9,9,9,1")], ids=str)
def test_edits_of_strands_that_there_are_not_are_refused(avatar: Avatar, edit: Edit) -> None:
    with pytest.raises(DynhairError, match="strand"):
        avatar.edited(edit)
