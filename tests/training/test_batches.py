"""The order of training frames, and their images."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from dynhair.capture import Capture
from dynhair.errors import DynhairError
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


@pytest.fixture
def damaged(tmp_path: Path) -> tuple[Capture, list[str]]:
    """A capture one frame of which has two truncated views of four, with their names."""
    capture = Capture.open(write_synthetic_capture(tmp_path / "c", frames=6, views=4, size=16))
    source = Batches(capture, training_segments(capture), views=2, image_size=16, seed=0)
    names = source.choice(1).names
    truncate(capture, source.segments[0].start + source.choice(1).index, names)
    return capture, names


def truncate(capture: Capture, frame: int, names: list[str]) -> None:
    for name in names:
        path = capture.layout.find_image(capture.layout.frame_images(frame), "image", name)
        assert path is not None
        path.write_bytes(path.read_bytes()[:60])


def forgiving(capture: Capture, reports: list[DynhairError]) -> Batches:
    return Batches(capture, training_segments(capture), views=2, image_size=16, seed=0, report=reports.append)


def test_other_views_stand_in_for_damaged_ones(damaged: tuple[Capture, list[str]]) -> None:
    capture, names = damaged
    reports: list[DynhairError] = []
    source = forgiving(capture, reports)
    assert source.batch(1).names == source.choice(1).spare[:2]
    assert len(reports) == 2
    assert sorted(source.batch(1).names) == sorted(set(capture.camera_names) - set(names))
    assert len(reports) == 2  # each is reported once
    assert source.batch(0).names == source.choice(0).names


def test_too_many_damaged_views_are_an_error(damaged: tuple[Capture, list[str]]) -> None:
    capture, _ = damaged
    reports: list[DynhairError] = []
    source = forgiving(capture, reports)
    truncate(capture, training_segments(capture)[0].start + source.choice(0).index, source.choice(0).names)
    source.batch(1)
    with pytest.raises(DynhairError, match="3 of 24 views cannot be read") as caught:
        source.batch(0)
    assert caught.value.expected == "at most 10% of them"
    assert len(reports) == 3


def test_where_too_few_views_are_left_they_are_taken_twice(damaged: tuple[Capture, list[str]]) -> None:
    capture, names = damaged
    source = forgiving(capture, [])
    frame = source.segments[0].start + source.choice(1).index
    rest = source.choice(1).spare
    source._broken = {(frame, name) for name in [*names, rest[0]]}
    assert source.batch(1).names == [rest[1], rest[1]]
    source._broken |= {(frame, rest[1])}
    with pytest.raises(DynhairError, match=f"no view of frame {frame} can be read"):
        source.batch(1)


def test_what_stands_in_does_not_depend_on_what_was_read_before(tmp_path: Path) -> None:
    capture = Capture.open(write_synthetic_capture(tmp_path / "c", frames=8, views=4, size=16))
    for frame, name in ((1, "00"), (4, "02"), (5, "03")):
        truncate(capture, training_segments(capture)[0].start + frame, [name])
    one, other = forgiving(capture, []), forgiving(Capture.open(capture.path), [])
    expected = [one.batch(step).names for step in range(16)]
    assert [other.batch(step).names for step in range(15, 7, -1)] == expected[:7:-1]
    assert any(names != one.choice(step).names for step, names in enumerate(expected))


def test_a_damaged_view_is_an_error_where_nobody_is_told(damaged: tuple[Capture, list[str]]) -> None:
    capture, _ = damaged
    with pytest.raises(DynhairError, match=r"damaged|not an image"):
        Batches(capture, training_segments(capture), views=2, image_size=16, seed=0).batch(1)


def test_shares_of_a_step_are_its_views_in_order(capture: Capture) -> None:
    segments = training_segments(capture)
    whole = Batches(capture, segments, views=3, image_size=32, seed=0)
    parts = [
        Batches(capture, segments, views=3, image_size=32, seed=0, share=lambda _, place=place: slice(place, place + 1))
        for place in range(3)
    ]
    for step in range(4):
        batch, shares = whole.batch(step), [part.batch(step) for part in parts]
        assert [share.first for share in shares] == [0, 1, 2]
        assert [name for share in shares for name in share.names] == batch.names
        assert torch.equal(torch.cat([share.rgb for share in shares]), batch.rgb)
        assert len({(share.segment, share.index) for share in [batch, *shares]}) == 1
