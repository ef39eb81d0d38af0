from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dynhair.capture import Manifest, Segment
from dynhair.errors import DynhairError
from dynhair.preprocess.workspace import STATIC, ViewId, Workspace

MANIFEST = Manifest(
    fps=24.0,
    image_size=(8, 6),
    camera_names=("left", "right"),
    segments=(Segment("nod", 0, 2, "train"), Segment("turn", 5, 1, "test")),
)


@pytest.fixture
def workspace(tmp_path: Path) -> Workspace:
    workspace = Workspace(tmp_path / "capture")
    workspace.write_manifest(MANIFEST, ["00"])
    return workspace


def test_views_come_in_order_of_time_with_static_ones_last(workspace: Workspace) -> None:
    assert workspace.views == (
        ViewId(0, "left"),
        ViewId(0, "right"),
        ViewId(1, "left"),
        ViewId(1, "right"),
        ViewId(5, "left"),
        ViewId(5, "right"),
        ViewId(STATIC, "00"),
    )


def test_a_new_workspace_on_the_folder_knows_what_was_imported(workspace: Workspace) -> None:
    again = Workspace(workspace.root)
    assert again.manifest.segments == MANIFEST.segments
    assert again.manifest.fps == 24
    assert again.static_names == ("00",)


@pytest.mark.parametrize("view", [ViewId(1, "left"), ViewId(STATIC, "00")])
def test_what_is_written_is_read_back(workspace: Workspace, view: ViewId) -> None:
    rng = np.random.default_rng(0)
    mask = rng.integers(0, 256, (6, 8)).astype(np.uint8)
    w2c, K = rng.normal(size=(3, 4)), np.array([[9.0, 0, 4], [0, 9, 3], [0, 0, 1]])
    workspace.write_mask(view, "hair", mask)
    workspace.write_image(view, np.full((6, 8, 3), 77, np.uint8))
    workspace.write_camera(view, w2c, K)
    assert np.array_equal(workspace.mask(view, "hair"), mask)
    assert np.abs(workspace.image(view).astype(int) - 77).max() <= 1
    assert np.allclose(workspace.camera(view).w2c, w2c, atol=1e-6)
    assert (workspace.camera(view).width, workspace.camera(view).height) == (8, 6)


def test_paths_are_those_that_captures_use(workspace: Workspace) -> None:
    assert workspace.image_path(ViewId(5, "right")) == workspace.root / "images/0005/image_right.jpg"
    assert workspace.image_path(ViewId(STATIC, "00"), "orient") == workspace.root / "static360/images/orient_00.png"
    assert workspace.camera_path(ViewId(STATIC, "00")) == workspace.root / "static360/cameras/camera_00.npz"


def test_nothing_imported_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(DynhairError, match="no recording has been imported"):
        _ = Workspace(tmp_path).views
