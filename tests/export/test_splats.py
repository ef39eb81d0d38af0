"""Splats look like the avatar, in files as other programs read them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from plyfile import PlyData
from scipy.spatial.transform import Rotation

from dynhair.avatar import Avatar, PosedAvatar
from dynhair.camera import Camera
from dynhair.errors import DynhairError
from dynhair.export.splats import LARGEST_OPACITY, Splats, write_splats
from dynhair.render import rasterize
from splat_files import read_splats
from tiny_avatars import front_camera, head_track, make_avatar


@pytest.fixture
def avatar() -> Avatar:
    avatar = make_avatar()
    with torch.no_grad():
        avatar.hair.higher_harmonics.normal_(std=0.1)
        avatar.hair.base_harmonic.add_(torch.randn(1, 3, 1).expand_as(avatar.hair.base_harmonic) * 0.2)
    return avatar


def posed(avatar: Avatar) -> PosedAvatar:
    with torch.no_grad():
        return avatar.pose(head_track(), 3)


def test_splats_read_back_draw_the_avatar(avatar: Avatar, tmp_path: Path) -> None:
    path = tmp_path / "posed.ply"
    write_splats(path, Splats.of(avatar, posed(avatar)))
    for camera in (front_camera(64), side_camera()):
        drawn = avatar.draw(posed(avatar), [camera]).rgb[0]
        seen = rasterize(read_splats(path).seen_from(camera), camera, background=avatar.background).features[0]
        assert psnr(drawn, seen) > 40
        assert psnr(drawn, avatar.background.expand_as(drawn)) < 30


def test_files_hold_what_3d_gaussian_splatting_expects(avatar: Avatar, tmp_path: Path) -> None:
    splats = Splats.of(avatar, posed(avatar))
    write_splats(tmp_path / "posed.ply", splats)
    table = PlyData.read(tmp_path / "posed.ply")["vertex"]
    names = [each.name for each in table.properties]
    assert names[:9] == ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
    assert names[9:54] == [f"f_rest_{i}" for i in range(45)]
    assert names[54:] == ["opacity", *(f"scale_{i}" for i in range(3)), *(f"rot_{i}" for i in range(4))]
    assert {each.val_dtype for each in table.properties} == {"f4"}

    def columns(*wanted: str) -> np.ndarray:
        return np.stack([np.asarray(table[name], np.float64) for name in wanted], 1)

    assert np.isfinite(columns(*names)).all()
    flip = np.array([1, -1, -1])
    np.testing.assert_array_equal(columns("x", "y", "z"), splats.means.numpy() * flip)
    opacities = 1 / (1 + np.exp(-columns("opacity")[:, 0]))
    np.testing.assert_allclose(opacities, splats.opacities.clamp_max(LARGEST_OPACITY), atol=1e-6)
    deviations = np.exp(columns("scale_0", "scale_1", "scale_2"))
    turns = Rotation.from_quat(columns("rot_1", "rot_2", "rot_3", "rot_0")).as_matrix()
    own = Rotation.from_quat(splats.quats[:, [1, 2, 3, 0]].numpy()).as_matrix()
    found, expected = (
        (turn * scales[:, None] ** 2) @ turn.swapaxes(1, 2)
        for turn, scales in ((turns, deviations), (np.diag(flip) @ own, splats.scales.numpy()))
    )
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-10)

    # what a viewer that stands at y-down coordinates computes, by the polynomials of Kerbl et al.'s rasterizer
    eye = side_camera().centre.numpy()
    sight = columns("x", "y", "z") - eye * flip
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    basis = kerbl_basis(*sight.T)
    rest = columns(*(f"f_rest_{i}" for i in range(45))).reshape(-1, 3, 15)
    base = columns("f_dc_0", "f_dc_1", "f_dc_2")
    colours = 0.5 + basis[0][:, None] * base + np.einsum("kn,nck->nc", basis[1:], rest)
    np.testing.assert_allclose(splats.seen_from(side_camera()).features, colours.clip(0), atol=1e-5)


def test_half_a_turn_twice_changes_nothing(avatar: Avatar) -> None:
    splats = Splats.of(avatar, posed(avatar))
    back = splats.half_turned().half_turned()
    torch.testing.assert_close(back.harmonics, splats.harmonics)
    torch.testing.assert_close(back.means, splats.means)
    torch.testing.assert_close(back.quats, -splats.quats)


def test_edited_hair_is_what_is_exported(avatar: Avatar) -> None:
    whole = posed(avatar)
    kept = torch.tensor([0, 3, 4, 11])
    segments = whole.strands.shape[1] - 1
    rows = (kept[:, None] * segments + torch.arange(segments)).flatten()
    look = replace(
        whole.hair,
        ids=kept,
        nearest=torch.cdist(whole.strands[:, 0], whole.strands[kept, 0]).argmin(1),
        widths=whole.hair.widths[kept] * 3,
        base_harmonic=whole.hair.base_harmonic[..., rows],
        higher_harmonics=whole.hair.higher_harmonics[..., rows],
    )
    cut = PosedAvatar(whole.strands[kept], whole.head, look)
    camera = front_camera(64)
    seen = rasterize(Splats.of(avatar, cut).seen_from(camera), camera, background=avatar.background).features[0]
    assert psnr(avatar.draw(cut, [camera]).rgb[0], seen) > 40
    assert psnr(avatar.draw(whole, [camera]).rgb[0], seen) < 35


def test_what_is_not_drawn_is_not_exported(avatar: Avatar) -> None:
    whole = posed(avatar)
    broken = whole.head.means.clone()
    broken[7] = torch.nan
    splats = Splats.of(avatar, replace(whole, head=replace(whole.head, means=broken)))
    assert len(splats.means) == len(Splats.of(avatar, whole).means) - 1


def test_colours_before_super_resolution_are_exported() -> None:
    avatar = make_avatar(super_resolution=2)
    coarse = avatar.draw(posed(avatar), [front_camera()]).coarse
    assert coarse is not None
    camera = front_camera().resized(20, 20)
    splats = Splats.of(avatar, posed(avatar))
    seen = rasterize(splats.seen_from(camera), camera, background=avatar.background).features[0]
    assert psnr(coarse[0], seen) > 40


def test_none_are_refused(avatar: Avatar, tmp_path: Path) -> None:
    none = Splats(*(every[:0] for every in vars(Splats.of(avatar, posed(avatar))).values()))
    with pytest.raises(DynhairError, match="no Gaussian"):
        write_splats(tmp_path / "posed.ply", none)


def side_camera() -> Camera:
    camera = front_camera(64)
    turn = torch.from_numpy(Rotation.from_euler("y", 1.2).as_matrix()).float()
    origin = torch.tensor([0, 0.7, 0])
    rotation = camera.w2c[:, :3] @ turn
    return replace(
        camera, w2c=torch.cat([rotation, (camera.w2c[:, :3] @ (origin - turn @ origin) + camera.w2c[:, 3])[:, None]], 1)
    )


def psnr(a: torch.Tensor, b: torch.Tensor) -> float:
    return float(-10 * (a - b).detach().square().mean().log10())


def kerbl_basis(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    xx, yy, zz, xy, yz, xz = x * x, y * y, z * z, x * y, y * z, x * z
    return np.stack(
        [
            0.28209479177387814 * np.ones_like(x),
            -0.4886025119029199 * y,
            0.4886025119029199 * z,
            -0.4886025119029199 * x,
            1.0925484305920792 * xy,
            -1.0925484305920792 * yz,
            0.31539156525252005 * (2 * zz - xx - yy),
            -1.0925484305920792 * xz,
            0.5462742152960396 * (xx - yy),
            -0.5900435899266435 * y * (3 * xx - yy),
            2.890611442640554 * xy * z,
            -0.4570457994644658 * y * (4 * zz - xx - yy),
            0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
            -0.4570457994644658 * x * (4 * zz - xx - yy),
            1.445305721320277 * z * (xx - yy),
            -0.5900435899266435 * x * (xx - 3 * yy),
        ]
    )
