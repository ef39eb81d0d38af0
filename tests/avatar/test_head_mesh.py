"""The mesh that an avatar keeps: with it on disk, through edits, and no harm where it is missing."""

from __future__ import annotations

from pathlib import Path

import pytest
import safetensors.torch
import torch
from torch import Tensor

from dynhair.avatar import Avatar, HeadMesh
from dynhair.avatar.head_mesh import HEAD_MESH
from dynhair.editing import Trim
from dynhair.errors import DynhairError
from tiny_avatars import make_avatar

MESH = HeadMesh(torch.rand(5, 3), torch.tensor([[0, 1, 2], [2, 3, 4]]))


def test_an_avatar_keeps_its_mesh(tmp_path: Path) -> None:
    avatar = make_avatar()
    avatar.head_mesh = MESH
    avatar.edited(Trim(0.5)).save(tmp_path / "edited")
    found = Avatar.load(tmp_path / "edited").frozen().head_mesh
    assert found is not None
    assert torch.equal(found.vertices, MESH.vertices)
    assert torch.equal(found.faces, MESH.faces)


def test_an_avatar_is_whole_without_it(tmp_path: Path) -> None:
    avatar = make_avatar()
    avatar.save(tmp_path / "plain")
    avatar.head_mesh = MESH
    avatar.save(tmp_path / "avatar")
    for name in ("avatar.json", "avatar.safetensors"):
        assert (tmp_path / "plain" / name).read_bytes() == (tmp_path / "avatar" / name).read_bytes()
    (tmp_path / "avatar" / HEAD_MESH).unlink()
    assert Avatar.load(tmp_path / "avatar").head_mesh is None


@pytest.mark.parametrize(
    "changed",
    [
        {"vertices": torch.rand(5, 2)},
        {"vertices": torch.zeros(5, 3, dtype=torch.int32)},
        {"vertices": torch.full((5, 3), torch.nan)},
        {"faces": torch.tensor([[0, 1, 5]])},
        {"faces": torch.tensor([[0, 1, -1]])},
        {"faces": torch.tensor([[0.0, 1.0, 2.0]])},
        {"faces": torch.zeros(0, 3, dtype=torch.int32)},
        {"faces": torch.tensor(3)},
    ],
)
def test_what_is_no_mesh_is_refused(tmp_path: Path, changed: dict[str, Tensor]) -> None:
    make_avatar().save(tmp_path / "avatar")
    safetensors.torch.save_file({**MESH.to_tensors(), **changed}, tmp_path / "avatar" / HEAD_MESH)
    with pytest.raises(DynhairError, match="no mesh") as caught:
        Avatar.load(tmp_path / "avatar")
    assert caught.value.path == tmp_path / "avatar" / HEAD_MESH


def test_a_damaged_file_is_named(tmp_path: Path) -> None:
    make_avatar().save(tmp_path / "avatar")
    (tmp_path / "avatar" / HEAD_MESH).write_bytes(b"nonsense")
    with pytest.raises(DynhairError, match="not readable") as caught:
        Avatar.load(tmp_path / "avatar")
    assert caught.value.path == tmp_path / "avatar" / HEAD_MESH
    assert caught.value.mend
