"""The canonical hairstyle from a tiny capture."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from dynhair.avatar import head_pose
from dynhair.capture import Capture
from dynhair.errors import DynhairError
from dynhair.strands import MeshDistance, segment_lengths
from dynhair.training import static_groom, static_hair
from dynhair.training.frames import head_frame, rest_frame
from dynhair.training.static_hair import fit_canonical_hair, strand_width
from dynhair.training.static_scene import render_hair, surface_gaussians
from dynhair.training.static_views import rest_views
from synthetic import write_synthetic_capture


@pytest.fixture(scope="module")
def capture_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("data") / "capture"
    return write_synthetic_capture(path, frames=2, views=3, size=48, static_views=4)


def fit(path: Path, iterations: int = 10, seed: int = 0) -> torch.Tensor:
    return fit_canonical_hair(
        Capture.open(path), strand_count=60, points=10, iterations=iterations, seed=seed, width=0.006
    )


@pytest.fixture(scope="module")
def fitted(capture_path: Path) -> torch.Tensor:
    return fit(capture_path)


def rest_vertices(capture: Capture) -> torch.Tensor:
    segment, index = rest_frame(capture)
    vertices = torch.from_numpy(capture.vertices(segment.start + index))
    return head_frame(capture.track(segment), index)(vertices)


def silhouette_error(capture: Capture, strands: torch.Tensor) -> float:
    assert capture.mesh is not None
    segment, index = rest_frame(capture)
    views = rest_views(capture, segment.start + index, head_pose(capture.track(segment), index))
    body = surface_gaussians(rest_vertices(capture), torch.from_numpy(capture.mesh.faces))
    images = render_hair(strands, 0.006, body, views.cameras)
    return float((images.coverage - views.hair).abs().mean())


def test_strands_grow_on_the_scalp_outside_of_the_head(capture_path: Path, fitted: torch.Tensor) -> None:
    capture = Capture.open(capture_path)
    assert capture.mesh is not None
    assert fitted.shape == (60, 10, 3)
    assert torch.isfinite(fitted).all()
    vertices, faces = rest_vertices(capture), torch.from_numpy(capture.mesh.faces)
    distance, _ = MeshDistance(vertices, faces).query(fitted[:, 1:].flatten(0, 1))
    assert distance.min() > -5e-3
    assert (distance < 0).float().mean() < 0.02
    scalp = MeshDistance(vertices, faces[torch.from_numpy(capture.mesh.scalp)])
    assert scalp.query(fitted[:, 0])[0].abs().max() < 1e-4


def test_segments_of_a_strand_are_equal(fitted: torch.Tensor) -> None:
    lengths = segment_lengths(fitted)
    assert (lengths.amax(1) / lengths.amin(1)).median() < 1.1


def test_a_seed_decides_the_result_bit_for_bit(capture_path: Path, fitted: torch.Tensor) -> None:
    assert torch.equal(fit(capture_path), fitted)
    assert not torch.equal(fit(capture_path, seed=1), fitted)


def test_ground_truth_is_not_read(capture_path: Path, fitted: torch.Tensor, tmp_path: Path) -> None:
    copy = tmp_path / "capture"
    shutil.copytree(capture_path, copy)
    shutil.rmtree(copy / "gt")
    assert torch.equal(fit(copy), fitted)


def test_refinement_brings_the_silhouette_closer(capture_path: Path) -> None:
    capture = Capture.open(capture_path)
    groomed = silhouette_error(capture, fit(capture_path, iterations=0))
    refined = silhouette_error(capture, fit(capture_path, iterations=80))
    assert refined < 0.9 * groomed


@pytest.mark.slow
def test_the_search_finds_a_better_groom_than_the_default(capture_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (static_groom, static_hair):
        monkeypatch.setattr(module, "FIRST_POPULATION", 40)
        monkeypatch.setattr(module, "GENERATIONS", 10)
        monkeypatch.setattr(module, "POPULATION", 10)
    misfits: list[float] = []
    fit_canonical_hair(
        Capture.open(capture_path),
        strand_count=60,
        points=10,
        iterations=0,
        seed=0,
        progress=lambda _step, _total, misfit: misfits.append(misfit),
    )
    assert len(misfits) == 140
    assert misfits[-1] < 0.8 * misfits[0]


def test_progress_counts_up_to_the_total(capture_path: Path) -> None:
    calls: list[tuple[int, int]] = []
    fit_canonical_hair(
        Capture.open(capture_path),
        strand_count=30,
        points=8,
        iterations=3,
        seed=0,
        progress=lambda step, total, _: calls.append((step, total)),
    )
    assert [step for step, _ in calls] == list(range(1, len(calls) + 1))
    assert {total for _, total in calls} == {len(calls)}


def test_orientations_and_static_views_are_optional(tmp_path: Path) -> None:
    path = write_synthetic_capture(tmp_path / "c", frames=2, views=2, size=32)
    for orientation in path.glob("**/orient_*.png"):
        orientation.unlink()
    assert torch.isfinite(fit(path, iterations=2)).all()


def test_no_masks_and_no_hair_are_refused(capture_path: Path, tmp_path: Path) -> None:
    bald = tmp_path / "bald"
    shutil.copytree(capture_path, bald)
    for mask in bald.glob("**/hair_*.png"):
        Image.fromarray(np.zeros((48, 48), np.uint8)).save(mask)
    with pytest.raises(DynhairError, match="shows hair"):
        fit(bald)
    for mask in bald.glob("**/hair_*.png"):
        mask.unlink()
    with pytest.raises(DynhairError, match="no hair masks"):
        fit(bald)


def test_more_strands_are_thinner_within_limits() -> None:
    assert strand_width(500) == pytest.approx(3e-3)
    assert strand_width(2000) < strand_width(1000)
    assert (strand_width(10), strand_width(100_000)) == (4e-3, 1e-4)
