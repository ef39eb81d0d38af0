"""The order of training frames, and their images."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from dynhair.capture import Capture
from dynhair.training.batches import Batches
from dynhair.training.frames import training_cameras, training_segments
from synthetic import write_synthetic_capture


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    path = tmp_path_factory.mktemp("data") / "capture"
    write_synthetic_capture(path, frames=5, views=3, size=32, motions=("turn:train", "tilt:train", "nod:test"))
    return Capture.open(path)


def batches(capture: Capture, *, seed: int = 0, image_size: int = 32) -> Batches:
    return Batches(capture, training_segments(capture), views=2, image_size=image_size, seed=seed)


def test_every_frame_comes_once_an_epoch_and_no_test_frame_ever(capture: Capture) -> None:
    source = batches(capture)
    for epoch in range(3):
        seen = [(c.segment, c.index) for c in map(source.choice, range(10 * epoch, 10 * (epoch + 1)))]
        assert sorted(seen) == [(s, i) for s in range(2) for i in range(5)]
    assert {segment.name for segment in source.segments} == {"turn", "tilt"}


def test_a_step_is_a_function_of_seed_and_step_alone(capture: Capture) -> None:
    one, other = batches(capture), batches(capture)
    assert [one.choice(s) for s in range(7, 12)] == [other.choice(s) for s in (7, 8, 9, 10, 11)]
    assert [one.choice(s) for s in range(12)] != [batches(capture, seed=1).choice(s) for s in range(12)]


def test_views_of_a_step_differ(capture: Capture) -> None:
    for step in range(20):
        names = batches(capture).choice(step).names
        assert len(set(names)) == 2


def test_reading_ahead_gives_the_same_batches(capture: Capture) -> None:
    source = batches(capture)
    for step, batch in zip(range(3, 7), source.from_step(3, 7), strict=True):
        expected = source.batch(step)
        assert (batch.segment, batch.index) == (expected.segment, expected.index)
        assert torch.equal(batch.rgb, expected.rgb)


def test_images_are_the_captures(capture: Capture) -> None:
    source = batches(capture)
    chosen = source.choice(0)
    frame = source.segments[chosen.segment].start + chosen.index
    view = capture.view(frame, chosen.names[1])
    batch = source.batch(0)
    assert view.hair is not None
    assert torch.equal(batch.rgb[1], view.rgb)
    assert torch.equal(batch.hair[1], view.hair)
    assert torch.equal(batch.body[1], (view.mask - view.hair).clamp_min(0))


def test_smaller_training_images_keep_colours_and_angles(capture: Capture) -> None:
    full, half = batches(capture).batch(0), batches(capture, image_size=16).batch(0)
    assert half.rgb.shape == (2, 16, 16, 3)
    assert (half.cameras[0].width, half.cameras[0].height) == (16, 16)
    torch.testing.assert_close(half.rgb.mean((1, 2)), full.rgb.mean((1, 2)))
    blocks = full.orientation.unfold(1, 2, 2).unfold(2, 2, 2).flatten(3)
    trusted = full.coherence.unfold(1, 2, 2).unfold(2, 2, 2).flatten(3)
    agreed = (blocks.amax(-1) - blocks.amin(-1) < 0.05) & (trusted.amin(-1) > 0.5) & (blocks.amin(-1) > 0.1)
    difference = (half.orientation - blocks.mean(-1)).abs()
    assert agreed.any()
    assert difference[agreed].max() < 0.05


def test_now_and_then_the_rest_frame_is_seen_from_its_static_views(tmp_path: Path) -> None:
    capture = Capture.open(write_synthetic_capture(tmp_path / "c", frames=4, views=2, size=32, static_views=12))
    source = Batches(capture, training_segments(capture), views=2, image_size=32, seed=0, static_every=4)
    rest = training_segments(capture)[0].start
    assert capture.static_frame == rest
    seen = set()
    for step in range(60):
        chosen = source.choice(step)
        assert chosen.static == (step % 4 == 3)
        if chosen.static:
            assert (chosen.segment, chosen.index) == (0, 0)
            seen |= set(chosen.names)
    names = capture.static_names
    assert seen == {name for place, name in enumerate(names) if place % 8 != 3}  # the others are to judge by
    batch, chosen = source.batch(3), source.choice(3)
    view, camera = capture.static_view(chosen.names[0]), capture.static_camera(chosen.names[0])
    assert torch.equal(batch.rgb[0], view.rgb)
    torch.testing.assert_close(batch.cameras[0].w2c, camera.w2c)
    without = Batches(capture, training_segments(capture), views=2, image_size=32, seed=0)
    assert not any(without.choice(step).static for step in range(20))


def test_a_single_camera_is_the_one_that_the_face_looks_at(capture: Capture) -> None:
    source = Batches(capture, training_segments(capture), views=2, image_size=32, seed=0, cameras=1)
    middle = capture.camera_names[1]  # of three, 50 degrees apart
    assert [source.choice(step).names for step in range(12)] == [[middle]] * 12


def test_more_cameras_are_the_most_frontal_ones_in_the_captures_order(capture: Capture) -> None:
    assert training_cameras(capture, 2) in (["00", "01"], ["01", "02"])
    assert training_cameras(capture, 0) == training_cameras(capture, 3) == list(capture.camera_names)
