from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dynhair.errors import DynhairError
from dynhair.preprocess.hair import LIP_HAIR, read_hair_mask

LABELS = np.random.default_rng(0).integers(0, 20, (12, 16), dtype=np.uint8)


@pytest.mark.parametrize("mode", ["L", "P"])
def test_label_maps(tmp_path: Path, mode: str):
    picture = Image.fromarray(LABELS)
    if mode == "P":
        picture = picture.convert("L")
        picture.putpalette(list(np.random.default_rng(1).integers(0, 256, 768)))
    picture.save(tmp_path / "labels.png")
    np.testing.assert_array_equal(
        read_hair_mask(tmp_path / "labels.png", LIP_HAIR), np.where(LABELS == 2, 255, 0).astype(np.uint8)
    )


def test_label_maps_of_16_bits(tmp_path: Path):
    Image.fromarray(LABELS.astype(np.uint16)).save(tmp_path / "labels.png")
    np.testing.assert_array_equal(read_hair_mask(tmp_path / "labels.png", 2) == 255, LABELS == 2)


def test_a_view_without_hair_is_no_error(tmp_path: Path):
    Image.fromarray(np.where(LABELS == 2, 0, LABELS)).save(tmp_path / "labels.png")
    assert not read_hair_mask(tmp_path / "labels.png", LIP_HAIR).any()


def test_masks(tmp_path: Path):
    mask = np.random.default_rng(2).integers(0, 256, (12, 16), dtype=np.uint8)
    for name, picture in (("grey", mask), ("colours", np.repeat(mask[..., None], 3, axis=2))):
        Image.fromarray(picture).save(tmp_path / f"{name}.png")
        np.testing.assert_array_equal(read_hair_mask(tmp_path / f"{name}.png"), mask)
    Image.fromarray(mask > 127).save(tmp_path / "bits.png")
    np.testing.assert_array_equal(read_hair_mask(tmp_path / "bits.png"), np.where(mask > 127, 255, 0))


@pytest.mark.parametrize(
    ("picture", "label", "complaint"),
    [
        (np.where(LABELS > 9, 255, 0).astype(np.uint8), 2, "values 0, 255"),
        (np.arange(192, dtype=np.uint8).reshape(12, 16), 2, "values 0, 1, 2"),
        (np.zeros((12, 16, 3), np.uint8), 2, "colours"),
        (LABELS, None, "too dark"),
        (np.stack([LABELS * 12, LABELS, LABELS], axis=-1), None, "in colours"),
        (LABELS.astype(np.uint16), None, "mode"),
    ],
)
def test_other_pictures_are_refused(tmp_path: Path, picture: np.ndarray, label: int | None, complaint: str):
    path = tmp_path / "mask.png"
    Image.fromarray(picture).save(path)
    with pytest.raises(DynhairError, match=complaint) as caught:
        read_hair_mask(path, label)
    assert str(path) in str(caught.value)
    assert "expected" in str(caught.value)


def test_files_that_are_no_pictures_are_refused(tmp_path: Path):
    with pytest.raises(DynhairError, match="missing"):
        read_hair_mask(tmp_path / "none.png")
    (tmp_path / "text.png").write_text("hair")
    with pytest.raises(DynhairError, match="not readable"):
        read_hair_mask(tmp_path / "text.png")
