"""All of preprocessing with the real networks, on pictures of the bundled capture, against its own maps."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from dynhair.avatar import Avatar
from dynhair.capture import Capture
from dynhair.preprocess.pipeline import preprocess
from dynhair.presets import PRESETS
from dynhair.training.trainer import train

pytestmark = pytest.mark.slow

BUNDLED = Path(__file__).parents[2] / "data/sample_capture"
SEGMENTS = {"turn": 24, "stop": 12}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    """A capture made from the pictures and cameras of the bundled one."""
    raw = tmp_path_factory.mktemp("raw") / "pictures"
    description = json.loads((BUNDLED / "capture.json").read_text())
    chosen = [{**s, "count": SEGMENTS[s["motion"]]} for s in description["segments"] if s["motion"] in SEGMENTS]
    for segment in chosen:
        for frame in range(segment["start"], segment["start"] + segment["count"]):
            shutil.copytree(BUNDLED / f"cameras/{frame:04d}", raw / f"cameras/{frame:04d}")
            (raw / f"images/{frame:04d}").mkdir(parents=True)
            for picture in (BUNDLED / f"images/{frame:04d}").glob("image_*"):
                shutil.copy(picture, raw / f"images/{frame:04d}")
    for kind in ("cameras", "images"):
        (raw / "static360" / kind).mkdir(parents=True)
        for path in (BUNDLED / "static360" / kind).glob(f"{kind[:-1]}_*"):
            shutil.copy(path, raw / "static360" / kind)
    (raw / "capture.json").write_text(json.dumps({**description, "segments": chosen}))
    out = raw.parent / "capture"
    preprocess(raw, out)
    return Capture.open(out)


@pytest.fixture(scope="module")
def truth() -> Capture:
    return Capture.open(BUNDLED)


def frames(made: Capture, truth: Capture) -> list[tuple[int, int]]:
    """Frames of the capture that was made, and the same ones of the bundled capture."""
    return [
        (segment.start + i, truth.segment(segment.name).start + i)
        for segment in made.segments
        for i in range(0, segment.count, 3)
    ]


def test_masks_and_orientation_are_close_to_the_true_ones(made: Capture, truth: Capture) -> None:
    overlaps, alphas, turns, trusts = [], [], [], []
    for frame, true_frame in frames(made, truth):
        for name in made.camera_names:
            view, true = made.view(frame, name), truth.view(true_frame, name)
            assert view.hair is not None
            assert view.orientation is not None
            assert view.coherence is not None
            assert true.hair is not None
            assert true.orientation is not None
            hair, true_hair = view.hair > 0.5, true.hair > 0.5
            overlaps.append(float((hair & true_hair).sum() / (hair | true_hair).sum()))
            alphas.append(float((view.mask - true.mask).abs().mean()))
            off = (view.orientation - true.orientation).abs()
            sure = true_hair & (view.coherence > 0.5)
            turns.append((180 * torch.minimum(off, 1 - off))[sure])
            trusts.append(float(sure.float().sum() / true_hair.sum()))
    assert np.mean(overlaps) > 0.8
    assert np.mean(alphas) < 0.03
    assert float(torch.cat(turns).mean()) < 15
    assert np.mean(trusts) > 0.05, "not by knowing nothing"


def test_the_head_is_tracked(made: Capture, truth: Capture) -> None:
    turned, moved = [], []
    for segment in made.segments:
        found, true = made.track(segment), truth.track(truth.segment(segment.name))
        true_rotations = true.rotations[: segment.count]
        turned.append(Rotation.from_matrix(true_rotations.swapaxes(1, 2) @ found.rotations))
        shift = found.translations - true.translations[: segment.count]
        moved.append(np.einsum("fji,fj->fi", true_rotations, shift))
    turns, shifts = Rotation.concatenate(turned), np.concatenate(moved)
    assert np.degrees(turns.magnitude()).mean() < 5
    assert np.degrees((turns.mean().inv() * turns).magnitude()).mean() < 3
    # where the origin of a head is, is a matter of the model
    assert np.linalg.norm(shifts - shifts.mean(0), axis=1).mean() < 0.005


def test_it_trains_as_it_is(made: Capture, tmp_path: Path) -> None:
    config = PRESETS["tiny"]
    config = replace(
        config,
        static=replace(config.static, encoder_iterations=2, iterations=8),
        training=replace(config.training, iterations=4),
    )
    train(made.path, tmp_path / "run", config)
    assert isinstance(Avatar.load(tmp_path / "run/avatar"), Avatar)
