"""The prior's training set on disk. Growth itself has its own tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from quick_styles import make_quick
from views import FRAME

from dynhair.errors import DynhairError
from dynhair.hairstyles import FAMILIES, HELD_OUT
from dynhair.prior import dataset
from dynhair.prior.dataset import FRONT_VIEWS, RING_VIEWS, TEXTURE, make_set, planned_shards, random_rig, read_set


def test_held_out_families_are_never_trained_on() -> None:
    shards = planned_shards(100, seed=3)
    assert [shard.name for shard in shards] == ["held_out", "known", "train_000", "train_001", "train_002"]
    trained = [family for shard in shards[2:] for family in shard.families]
    assert len(trained) == 100
    assert set(trained) == set(FAMILIES) - set(HELD_OUT)
    assert set(shards[0].families) == set(HELD_OUT)
    assert len({shard.seed for shard in shards}) == len(shards)
    counts = [trained.count(family) for family in set(trained)]
    assert max(counts) - min(counts) <= 1


def test_a_rig_has_views_in_front_and_all_around() -> None:
    cameras = random_rig(np.random.Generator(np.random.PCG64(0)), FRAME)
    away = torch.stack([camera.centre - FRAME.centre for camera in cameras])
    azimuths = torch.rad2deg(torch.atan2(away[:, 0], away[:, 2]))
    assert len(cameras) == FRONT_VIEWS + RING_VIEWS
    assert azimuths[:FRONT_VIEWS].abs().max() < 65
    around = torch.remainder(azimuths[FRONT_VIEWS:], 360).sort().values
    assert around.diff().max() < 45
    for camera in cameras:
        (pixel,), depth = camera.project(FRAME.centre[None])
        assert (pixel > 0).all()
        assert (pixel < camera.width).all()
        assert 0.5 < float(depth) < 1.8
        torch.testing.assert_close(camera.w2c[:, :3] @ camera.w2c[:, :3].T, torch.eye(3), atol=1e-5, rtol=0)
        assert torch.linalg.det(camera.w2c[:, :3]) > 0


def test_a_set_on_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_quick(monkeypatch)
    calls: list[tuple[int, int]] = []
    make_set(tmp_path, 2, 1, lambda done, total: calls.append((done, total)))
    assert [done for done, _ in calls] == sorted(done for done, _ in calls)
    assert calls[-1] == (4, 4)
    styles = read_set(tmp_path, "train")
    assert len(styles) == 2
    assert styles[0].family != styles[1].family
    for style in styles:
        assert style.strands.shape == (len(style.texels), 64, 3)
        assert not style.strands[:, 0].any()
        assert int(style.texels.max()) < TEXTURE**2
        assert style.hair.shape == (28, 32, 32)
        assert (style.hair > 128).mean() > 0.01
        # The direction's magnitude is at most the coverage.
        magnitude = np.hypot(*np.moveaxis(style.direction.astype(float), -1, 0)) / 127
        assert (magnitude <= style.hair / 255 + 0.02).all()
        assert np.isinf(style.body_depth).any()
        assert np.isfinite(style.body_depth).any()
    # Going on makes what is missing again and leaves the rest.
    kept, lost = tmp_path / "known.npz", tmp_path / "train_000.npz"
    stamp, before = kept.stat().st_mtime_ns, styles[1].hair
    lost.unlink()
    make_set(tmp_path, 2, 1)
    assert kept.stat().st_mtime_ns == stamp
    np.testing.assert_array_equal(read_set(tmp_path, "train")[1].hair, before)
    with pytest.raises(DynhairError, match="another set"):
        make_set(tmp_path, 2, seed=2)
    lost.write_bytes(kept.read_bytes()[:5000])
    with pytest.raises(DynhairError, match="not readable"):
        read_set(tmp_path, "train")
    with pytest.raises(DynhairError, match="no hairstyles"):
        read_set(tmp_path / "nowhere", "train")


@pytest.mark.slow
def test_real_hairstyles_are_grown_and_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dataset, "_VALIDATION_STYLES", 1)
    make_set(tmp_path, 1, seed=0)
    (style,) = read_set(tmp_path, "train")
    lengths = style.strands.float().diff(dim=1).norm(dim=-1)
    assert (lengths.amax(1) / lengths.amin(1).clamp_min(1e-4)).median() < 1.2
    assert (style.hair > 128).mean() > 0.02
