"""What the page offers, without a page: motions, expressions, colours, pictures."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from scipy.spatial.transform import Rotation

from dynhair.animation.procedural import MOTIONS
from dynhair.avatar import ExpressionModes
from dynhair.capture import Capture, ExpressionBasis
from dynhair.errors import DynhairError
from dynhair.export.splats import Splats
from dynhair.render import Gaussians
from dynhair.viewer.browser_scene import MOST_SEGMENTS, browser_splats, scaled_moments, strand_lines
from dynhair.viewer.drawing import cut_out, picture
from dynhair.viewer.expression_sliders import expression_sliders
from dynhair.viewer.motions import named_clips
from dynhair.viewer.saving import snapshot, splat_file
from dynhair.viewer.speed_colours import FASTEST, colour_bar, coloured_by_speed
from dynhair.viewer.viewpoint import Viewpoint
from splat_files import read_splats
from synthetic import write_synthetic_capture
from tiny_avatars import front_camera, head_track, make_avatar

AVATAR = make_avatar(basis=ExpressionBasis("someone", ("a", "b", "c", "d"))).eval().requires_grad_(False)
POSED = AVATAR.pose(head_track(), 2)


def test_motions_by_name_come_first_then_the_captures_training_ones(tmp_path: Path) -> None:
    assert AVATAR.recording is not None
    capture = Capture.open(write_synthetic_capture(tmp_path / "capture", motions=("nod:test", "turn:train"), frames=3))
    avatar = make_avatar()
    clips = named_clips(AVATAR.recording, capture, avatar)
    assert list(clips) == [*MOTIONS, "turn (recorded, train)", "nod (recorded, test)"]
    assert [clip.frames for clip in clips.values()][-2:] == [3, 3]
    assert list(named_clips(AVATAR.recording, None, avatar)) == list(MOTIONS)


def test_a_capture_of_another_face_model_is_refused(tmp_path: Path) -> None:
    assert AVATAR.recording is not None
    capture = Capture.open(write_synthetic_capture(tmp_path / "capture", frames=3))
    avatar = make_avatar()
    avatar.head.expression_size = 7
    with pytest.raises(DynhairError, match="4 expression coefficients"):
        named_clips(AVATAR.recording, capture, avatar)


def test_the_strongest_expressions_get_sliders_that_reach_as_far_as_was_seen() -> None:
    avatar, track = make_avatar(basis=AVATAR.expression_basis), head_track()
    modes = ExpressionModes.blank(4, 4, 3)
    modes.coefficients.copy_(torch.arange(4))
    modes.offsets.data.copy_(torch.tensor([0.0, 1.0, 3.0, 2.0])[:, None, None])
    avatar.head.modes = modes
    track.expressions[:] = [[5, 1, 0.5, 2]]
    track.expressions[0] = 0
    sliders = expression_sliders(avatar, [track])
    assert [slider.label for slider in sliders] == ["d", "c", "b"]  # 4, 1.5, 1; the first moves nothing
    assert [slider.reach for slider in sliders] == [2.0, 0.5, 1.0]
    assert [slider.index for slider in expression_sliders(avatar, [], count=2)] == [2, 3]


def test_expressions_without_names_are_numbered() -> None:
    assert {slider.label for slider in expression_sliders(make_avatar(), [])} == {f"coefficient {i}" for i in range(4)}


def test_the_ends_of_the_colour_bar_are_the_colours_of_rest_and_of_the_fastest() -> None:
    speeds = torch.zeros(20)
    speeds[3] = 2 * FASTEST
    coloured = coloured_by_speed(POSED, speeds)
    seen = Splats.of(AVATAR, coloured).seen_from(front_camera()).features[: 20 * 7].view(20, 7, 3)
    bar = torch.from_numpy(colour_bar()[0] / 255).float()
    torch.testing.assert_close(seen[3], bar[-1].expand(7, 3), atol=0.01, rtol=0)
    torch.testing.assert_close(seen[5], bar[0].expand(7, 3), atol=0.01, rtol=0)
    assert POSED.hair.higher_harmonics is not coloured.hair.higher_harmonics


def test_strands_that_are_left_keep_their_own_speeds() -> None:
    from dynhair.editing import Thin

    thin = AVATAR.edited(Thin(0.5)).pose(head_track(), 2)
    speeds = torch.linspace(0, FASTEST, 20)
    whole = coloured_by_speed(POSED, speeds).hair.base_harmonic.view(3, 20, 7)
    part = coloured_by_speed(thin, speeds).hair.base_harmonic.view(3, 10, 7)
    torch.testing.assert_close(part, whole[:, thin.hair.ids])


def test_a_snapshot_on_the_background_is_the_picture() -> None:
    cut = cut_out(AVATAR, POSED, front_camera()).astype(float) / 255
    whole = picture(AVATAR, POSED, front_camera()).astype(float) / 255
    alpha = cut[..., 3:]
    assert alpha.min() == 0
    assert alpha.max() > 0.9
    over = alpha * cut[..., :3] + (1 - alpha) * AVATAR.background.numpy()
    np.testing.assert_allclose(over, whole, atol=2.5 / 255)


@pytest.mark.parametrize("super_resolution", [1, 2])
def test_files_are_what_they_are_called(super_resolution: int, tmp_path: Path) -> None:
    avatar = make_avatar(super_resolution).eval().requires_grad_(False)
    posed = avatar.pose(head_track(), 0)
    image = Image.open(
        io.BytesIO(snapshot(avatar, posed, Viewpoint((0.0, 1.0, 0.0, 0.0), (0.0, 0.7, 0.8), 0.5, (90, 60))))
    )
    assert (image.format, image.mode, image.size) == ("PNG", "RGBA", (1536, 1024))
    (tmp_path / "splats.ply").write_bytes(splat_file(avatar, posed))
    assert len(read_splats(tmp_path / "splats.ply").means) == 20 * 7 + 100


def test_what_the_browser_draws_are_the_exported_splats_as_one_camera_sees_them() -> None:
    fast = browser_splats(AVATAR, POSED, front_camera())
    exported = Splats.of(AVATAR, POSED).seen_from(front_camera())
    scalp = torch.zeros(20 * 7 + 100, dtype=torch.bool)
    scalp[20 * 7 :: 5] = True  # its colours are those of the hair from another place, a little off
    for name in ("means", "scales", "opacities"):
        torch.testing.assert_close(getattr(fast, name), getattr(exported, name))
    torch.testing.assert_close(fast.features[~scalp], exported.features[~scalp], atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(fast.features[scalp], exported.features[scalp], atol=0.1, rtol=0)


def test_moments_are_those_of_the_gaussians_in_centimetres() -> None:
    drawn = Splats.of(AVATAR, POSED).seen_from(front_camera())
    means, covariances = scaled_moments(drawn)
    axes = Rotation.from_quat(drawn.quats.numpy(), scalar_first=True).as_matrix()
    expected = axes @ (np.eye(3) * (drawn.scales.numpy() ** 2)[:, None]) @ axes.transpose(0, 2, 1)
    np.testing.assert_allclose(covariances, 1e4 * expected, rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(means, 100 * drawn.means.numpy(), rtol=1e-6)
    halved = covariances[: 20 * 7].astype(np.float16).astype(np.float32)
    np.testing.assert_allclose(halved, covariances[: 20 * 7], rtol=1e-3, atol=1e-6)


def test_lines_are_the_segments_of_evenly_chosen_strands() -> None:
    count = MOST_SEGMENTS // 2
    strands = torch.randn(count, 4, 3)
    features = torch.rand(count, 1, 3).expand(-1, 3, -1).flatten(0, 1)
    n = len(features)
    drawn = Gaussians(torch.zeros(n, 3), torch.zeros(n, 4), torch.zeros(n, 3), torch.zeros(n), features)
    ends, colours = strand_lines(strands, drawn)
    assert ends.shape == colours.shape == (count // 2 * 3, 2, 3)
    assert len(ends) <= MOST_SEGMENTS
    np.testing.assert_array_equal(ends[3:6, 0], strands[2, :-1])
    np.testing.assert_array_equal(ends[3:6, 1], strands[2, 1:])
    srgb = np.where(colours < 0.8, colours / 255 * 12.92, 1.055 * (colours / 255) ** (1 / 2.4) - 0.055)
    np.testing.assert_allclose(srgb[3], features[6].expand(2, 3), atol=0.02)
