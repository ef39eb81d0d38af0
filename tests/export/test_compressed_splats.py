"""Compressed splats, as gsply reads them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial import KDTree

from dynhair.errors import DynhairError
from dynhair.export.compressed import CHUNK, write_compressed_splats
from dynhair.export.splats import Splats, write_splats


def random_splats(count: int) -> Splats:
    generator = torch.Generator().manual_seed(count)

    def normal(*shape: int) -> torch.Tensor:
        return torch.randn(shape, generator=generator)

    return Splats(
        means=normal(count, 3) * 0.1 + torch.tensor([0, 0.7, 0]),
        quats=torch.nn.functional.normalize(normal(count, 4), dim=1),
        scales=torch.exp(normal(count, 3) - 6),
        opacities=(normal(count) * 2).sigmoid().where(torch.arange(count) % 2 == 0, torch.tensor(1.0)),
        harmonics=normal(count, 16, 3) * 0.3,
    )


def read(path: Path) -> Splats:
    import gsply

    found = gsply.plyread(path)
    arrays = (found.means, found.quats, np.exp(found.scales), 1 / (1 + np.exp(-found.opacities)))
    assert found.shN is not None
    harmonics = np.concatenate([found.sh0[:, None], found.shN], 1)
    return Splats(*(torch.from_numpy(np.array(every, np.float32)) for every in (*arrays, harmonics))).half_turned()


@pytest.mark.slow  # gsply compiles itself first
@pytest.mark.parametrize("count", [1, CHUNK, 3 * CHUNK + 17])
def test_everything_comes_back_within_its_bits(count: int, tmp_path: Path) -> None:
    path = tmp_path / "posed.compressed.ply"
    splats = random_splats(count)
    write_compressed_splats(path, splats)
    found = read(path)
    assert len(found.means) == count
    # neighbours share bounds: positions are within half of a 2^-10 of a chunk's extent at most
    extent = (splats.means.max(0).values - splats.means.min(0).values).max().item() + 1e-6
    distances, order = KDTree(splats.means.numpy()).query(found.means.numpy())
    assert distances.max() <= extent / 2**10
    if count == 1:
        order = np.zeros(1, int)
    own = Splats(*(every[order] for every in vars(splats).values()))
    same = (own.quats * found.quats).sum(1).abs()
    assert same.min() > 1 - 2e-5
    spread = (splats.scales.log().max() - splats.scales.log().min()).item()
    torch.testing.assert_close(found.scales.log(), own.scales.log(), atol=spread / 1023 + 1e-5, rtol=0)
    torch.testing.assert_close(found.opacities, own.opacities, atol=0.5 / 255 + 1e-4, rtol=0)
    base = (splats.harmonics[:, 0].max() - splats.harmonics[:, 0].min()).item()
    torch.testing.assert_close(found.harmonics[:, 0], own.harmonics[:, 0], atol=base / 255 + 1e-4, rtol=0)
    torch.testing.assert_close(found.harmonics[:, 1:], own.harmonics[:, 1:], atol=8 / 256 + 1e-4, rtol=0)


@pytest.mark.slow
def test_plain_colours_get_no_tint(tmp_path: Path) -> None:
    splats = random_splats(2000)
    splats.harmonics[:, 1:] = 0
    write_compressed_splats(tmp_path / "posed.compressed.ply", splats)
    higher = read(tmp_path / "posed.compressed.ply").harmonics[:, 1:]
    assert higher.abs().max() < 0.016
    assert higher.mean(0).abs().max() < 0.002


@pytest.mark.slow
def test_gsply_reads_plain_splats_as_they_are(tmp_path: Path) -> None:
    splats = random_splats(100)
    write_splats(tmp_path / "posed.ply", splats)
    found = read(tmp_path / "posed.ply")
    torch.testing.assert_close(found.means, splats.means)
    torch.testing.assert_close(found.harmonics, splats.harmonics)
    torch.testing.assert_close(found.quats, splats.half_turned().half_turned().quats)


def test_it_is_a_quarter_of_the_size(tmp_path: Path) -> None:
    splats = random_splats(10 * CHUNK)
    write_splats(tmp_path / "posed.ply", splats)
    write_compressed_splats(tmp_path / "posed.compressed.ply", splats)
    assert (tmp_path / "posed.compressed.ply").stat().st_size < 0.27 * (tmp_path / "posed.ply").stat().st_size


def test_what_can_hardly_be_seen_is_written_too(tmp_path: Path) -> None:
    splats = random_splats(4)
    splats.opacities[:3] = torch.tensor([0.0, 1e-44, 1e-30])
    splats.scales[2] = 0.0
    write_compressed_splats(tmp_path / "posed.compressed.ply", splats)
    header, _, body = (tmp_path / "posed.compressed.ply").read_bytes().partition(b"end_header\n")
    assert b"element vertex 4" in header
    packed = np.frombuffer(body[18 * 4 :], "<u4", 16).reshape(4, 4)
    assert sorted(packed[:, 3] & 255)[:3] == [0, 0, 0]


def test_nothing_is_refused(tmp_path: Path) -> None:
    none = Splats(*(every[:0] for every in vars(random_splats(4)).values()))
    with pytest.raises(DynhairError, match="no Gaussian"):
        write_compressed_splats(tmp_path / "posed.compressed.ply", none)
