from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.synthetic import write_synthetic_capture
from tools.cut_capture import cut_capture
from tools.decimation import decimate

from dynhair.capture import Capture, ExpressionBasis, Segment
from dynhair.capture.check import check_capture
from dynhair.errors import DynhairError


def sphere(rings: int, sectors: int) -> tuple[np.ndarray, np.ndarray]:
    polar = np.linspace(0, np.pi, rings + 2)[1:-1, None]
    round_ = np.linspace(0, 2 * np.pi, sectors, endpoint=False)
    ring = np.stack([np.sin(polar) * np.cos(round_), np.sin(polar) * np.sin(round_), np.cos(polar) + 0 * round_], -1)
    vertices = np.vstack([ring.reshape(-1, 3), [[0, 0, 1], [0, 0, -1]]])
    top, bottom = len(vertices) - 2, len(vertices) - 1
    faces = []
    for j in range(sectors):
        k = (j + 1) % sectors
        faces += [(top, j, k), (bottom, (rings - 1) * sectors + k, (rings - 1) * sectors + j)]
        for i in range(rings - 1):
            a, b, c, d = i * sectors + j, i * sectors + k, (i + 1) * sectors + j, (i + 1) * sectors + k
            faces += [(a, c, d), (a, d, b)]
    return vertices, np.array(faces)


def edge_counts(faces: np.ndarray) -> np.ndarray:
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    return np.unique(edges, axis=0, return_counts=True)[1]


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return float((a * np.cross(b, c)).sum() / 6)


@given(rings=st.integers(4, 9), sectors=st.integers(5, 14), share=st.floats(0.3, 0.9), seed=st.integers(0, 99))
def test_a_decimated_sphere_stays_a_sphere(rings: int, sectors: int, share: float, seed: int) -> None:
    vertices, faces = sphere(rings, sectors)
    locked = np.random.default_rng(seed).choice(len(vertices), 4, replace=False)
    stretched = vertices * [1, 2, 1]
    target = max(12, int(share * len(vertices)))
    kept, left = decimate(np.stack([vertices, stretched]), faces, target, locked=locked)
    left = left[left[:, 0] >= 0]
    assert len(kept) == target
    assert set(locked) <= set(kept)
    assert set(left.ravel()) == set(kept)
    assert (edge_counts(left) == 2).all(), "closed and manifold"
    assert len(left) == 2 * len(kept) - 4, "of genus 0"
    assert 0.5 * volume(vertices, faces) < volume(vertices, left) <= volume(vertices, faces) + 1e-9


def test_flat_parts_and_straight_edges_cost_nothing() -> None:
    count = 8
    grid = np.stack([*np.meshgrid(np.arange(count), np.arange(count)), np.zeros((count, count))], -1).reshape(-1, 3)
    index = np.arange(count * count).reshape(count, count)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    faces = np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in ((a, b, d), (a, d, c))])
    kept, left = decimate(grid[None], faces, 10)
    left = left[left[:, 0] >= 0]
    corners = {0, count - 1, count * (count - 1), count * count - 1}
    assert corners <= set(kept), "the outline is kept"
    x, y = grid[left][..., 0], grid[left][..., 1]
    area = 0.5 * ((x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0]))
    assert (area > 0).all()
    assert area.sum() == pytest.approx((count - 1) ** 2)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("captures") / "source"
    motions = ("turn:train", "tilt:train", "nod:test")
    return write_synthetic_capture(path, frames=4, views=3, size=40, motions=motions, static_views=4)


def cut(source: Path, out: Path, motions: tuple[str, ...] = ("turn", "nod"), **options: Any) -> Capture:
    sizes = {"frames": 3, "static_views": 2, "mesh_vertices": 200, "gt_strands": 5}
    cut_capture(source, out, motions=motions, views=("00", "02"), **sizes, **options)
    return Capture.open(out)


def test_a_cut_is_a_sound_capture_of_the_same_scene(source: Path, tmp_path: Path) -> None:
    whole, part = Capture.open(source), cut(source, tmp_path / "part")
    assert check_capture(part.path) == []
    assert part.segments == (Segment("turn", 0, 3, "train"), Segment("nod", 3, 3, "test"))
    assert part.static_names == ("00", "02")
    assert whole.mesh is not None
    assert part.mesh is not None
    for old, new in ((0, 0), (2, 2), (8, 3), (10, 5)):
        before, after = whole.view(old, "02"), part.view(new, "02")
        assert (before.rgb - after.rgb).abs().mean() < 0.03
        assert (before.mask - after.mask).abs().max() <= 0.5 / 7 + 0.01
        np.testing.assert_allclose(part.camera(new, "02").w2c, whole.camera(old, "02").w2c)
        scalp = whole.vertices(old)[whole.mesh.faces[whole.mesh.scalp]]
        np.testing.assert_allclose(part.vertices(new)[part.mesh.faces[part.mesh.scalp]], scalp, atol=5e-4)
        landmarks = whole.vertices(old)[whole.mesh.landmarks]
        np.testing.assert_allclose(part.vertices(new)[part.mesh.landmarks], landmarks, atol=5e-4)
    np.testing.assert_allclose(
        part.track(part.segment("nod")).rotations, whole.track(whole.segment("nod")).rotations[:3], atol=1e-6
    )
    truth, strands = whole.ground_truth(whole.segment("nod")), part.ground_truth(part.segment("nod"))
    assert truth is not None
    assert strands is not None
    assert strands.strands.shape == (3, 5, 16, 3)
    np.testing.assert_allclose(strands.strands[:, :, [0, -1]], truth.strands[:3, :5, [0, -1]], atol=5e-4)


def test_expressions_have_the_names_that_are_given_or_those_of_the_source(source: Path, tmp_path: Path) -> None:
    named = cut(source, tmp_path / "named", face_model="faces", expressions=("jaw", "smile"))
    assert named.expression_basis == ExpressionBasis("faces", ("jaw", "smile", "", ""))
    again = cut(named.path, tmp_path / "again")
    assert again.expression_basis == named.expression_basis
    with pytest.raises(DynhairError, match="4 expression coefficients"):
        cut(source, tmp_path / "part", expressions=("a", "b", "c", "d", "e"))


def test_static_views_need_their_frame(source: Path, tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match="frame of the static views"):
        cut(source, tmp_path / "part", motions=("tilt", "nod"))
    assert not (tmp_path / "part").exists()
