from __future__ import annotations

import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tests.synthetic import HEAD_ORIGIN

from dynhair.camera import Camera
from dynhair.capture import Capture, CaptureWriter, ImageCoding, Manifest, Segment, TrackedMesh, View
from dynhair.capture.encoding import decode_orientation, encode_orientation
from dynhair.errors import DynhairError


def random_view(generator: torch.Generator, height: int, width: int) -> View:
    def noise(*channels: int) -> torch.Tensor:
        return torch.rand(height, width, *channels, generator=generator)

    return View(rgb=noise(3), mask=noise(), hair=noise(), orientation=noise(), coherence=noise())


def undirected_difference(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    gap = (a - b).abs() % 1
    return torch.minimum(gap, 1 - gap)


def test_what_is_written_is_read(tmp_path: Path) -> None:
    generator, numbers = torch.Generator().manual_seed(0), np.random.default_rng(0)
    width, height = 20, 12
    segments = (Segment("nod", 5, 2, "train"), Segment("stop", 9, 1, "test"))
    manifest = Manifest(
        fps=30.0,
        image_size=(width, height),
        camera_names=("left", "right"),
        segments=segments,
        gravity=(0.0, 0.0, -9.8),
        background=(0.0, 0.5, 1.0),
        static_frame=6,
    )
    K = torch.tensor([[30.0, 0, 10.5], [0, 31.0, 6.5], [0, 0, 1]])
    camera = Camera(torch.cat([torch.eye(3), torch.tensor([[0.1], [0.2], [3.0]])], 1), K, width, height)
    frames = [frame for segment in segments for frame in segment.frames]
    views = {(f, n): random_view(generator, height, width) for f in frames for n in manifest.camera_names}
    static = random_view(generator, height, width)
    rotations = Rotation.from_rotvec(numbers.normal(size=(3, 3))).as_matrix()
    translations, expressions = numbers.normal(size=(3, 3)), numbers.random((3, 7), np.float32)
    vertices = numbers.random((80, 3), np.float32)
    landmarks_3d, landmarks_2d = numbers.random((66, 3), np.float32), numbers.random((68, 3), np.float32)
    mesh = TrackedMesh(
        faces=numbers.integers(0, 80, (30, 3)),
        scalp=np.arange(4),
        follow=np.ones(80, np.float32),
        landmarks=np.arange(68),
    )
    strands = numbers.random((2, 5, 4, 3), np.float32)

    with CaptureWriter.create(tmp_path / "c", manifest, coding=ImageCoding(image_format="png")) as writer:
        for i, frame in enumerate(frames):
            writer.write_head(frame, rotations[i], translations[i], expressions[i], scale=0.1)
            writer.write_vertices(frame, vertices + i)
            writer.write_landmarks_3d(frame, landmarks_3d + i)
        for (frame, name), view in views.items():
            writer.write_view(frame, name, camera, view)
        writer.write_landmarks_2d(5, "left", landmarks_2d)
        writer.write_static_view("back", camera, static)
        writer.write_mesh(mesh)
        writer.write_ground_truth(segments[0], strands)
        assert not (tmp_path / "c").exists(), "a capture appears when it is complete"

    capture = Capture.open(tmp_path / "c")
    assert (capture.name, capture.fps, capture.image_size) == ("c", 30.0, (width, height))
    assert (capture.camera_names, capture.static_names) == (("left", "right"), ("back",))
    assert (capture.segments, capture.segment("stop"), capture.static_frame) == (segments, segments[1], 6)
    np.testing.assert_array_equal(capture.gravity, [0, 0, -9.8])
    np.testing.assert_array_equal(capture.background, [0, 0.5, 1])
    for requested, found in zip(views, capture.views(list(views)), strict=True):
        assert_close(found, views[requested])
    assert_close(capture.static_view("back"), static)
    for found in (capture.camera(9, "right"), capture.static_camera("back")):
        torch.testing.assert_close(found.w2c, camera.w2c)
        torch.testing.assert_close(found.K, camera.K)
        assert (found.width, found.height) == (width, height)
    track = capture.track(segments[0])
    np.testing.assert_allclose(track.rotations, rotations[:2], atol=1e-6)
    np.testing.assert_allclose(track.translations, translations[:2], atol=1e-6)
    np.testing.assert_array_equal(track.expressions, expressions[:2])
    assert track.fps == 30.0
    np.testing.assert_array_equal(capture.vertices(6), vertices + 1)
    np.testing.assert_array_equal(capture.landmarks_3d(6), landmarks_3d + 1)
    np.testing.assert_array_equal(capture.landmarks_2d(5, "left"), landmarks_2d)
    assert capture.landmarks_2d(5, "right") is None
    assert capture.mesh is not None
    for field in ("faces", "scalp", "follow", "landmarks"):
        np.testing.assert_array_equal(getattr(capture.mesh, field), getattr(mesh, field))
    truth = capture.ground_truth(segments[0])
    assert truth is not None
    np.testing.assert_array_equal(truth.strands, strands)
    later = capture.ground_truth(Segment("nod", 6, 1, "train"))
    assert later is not None
    np.testing.assert_array_equal(later.strands, strands[1:])
    assert capture.ground_truth(segments[1]) is None


def assert_close(found: View, written: View) -> None:
    half_a_step = 0.5001
    for field, steps in (("rgb", 255), ("mask", 255), ("hair", 255), ("coherence", 15)):
        torch.testing.assert_close(getattr(found, field), getattr(written, field), rtol=0, atol=half_a_step / steps)
    assert found.orientation is not None
    assert written.orientation is not None
    assert undirected_difference(found.orientation, written.orientation).max() <= half_a_step / 256


@given(
    angle=st.floats(-3, 3, width=32),
    coherence=st.floats(0, 1, width=32),
    step=st.sampled_from([1, 2, 8, 16]),
    levels=st.sampled_from([2, 4, 16]),
)
def test_orientation_codes_are_within_half_a_step(angle: float, coherence: float, step: int, levels: int) -> None:
    pixels = encode_orientation(
        np.full((1, 1), angle, np.float32),
        np.full((1, 1), coherence, np.float32),
        angle_step=step,
        coherence_levels=levels,
    )
    found, agreement = decode_orientation(pixels)
    assert 0 <= found.item() < 1
    assert undirected_difference(found, torch.tensor(angle)).item() <= step / 512 + 1e-6
    # levels between two of the sixteen that are stored are rounded once more
    assert abs(agreement.item() - coherence) <= 0.5 / (levels - 1) + 0.5 / 15 + 1e-6


@pytest.mark.parametrize("levels", [2, 5, 16, 100, 256])
def test_masks_of_few_levels_are_within_half_a_level(tmp_path: Path, levels: int) -> None:
    view = random_view(torch.Generator().manual_seed(1), 16, 16)
    manifest = Manifest(
        fps=1.0, image_size=(16, 16), camera_names=("0",), segments=(Segment("s", 0, 1, "train"),), static_frame=0
    )
    camera = Camera(torch.eye(3, 4), torch.eye(3), 16, 16)
    with CaptureWriter.create(tmp_path / "c", manifest, coding=ImageCoding(mask_levels=levels)) as writer:
        writer.write_view(0, "0", camera, view)
    found = Capture.open(tmp_path / "c").view(0, "0")
    torch.testing.assert_close(found.mask, view.mask, rtol=0, atol=0.5 / (levels - 1) + 0.5 / 255 + 1e-6)
    assert len(found.mask.unique()) <= levels


def test_the_synthetic_capture_is_consistent(pristine: Path) -> None:
    capture = Capture.open(pristine)
    mesh = capture.mesh
    assert mesh is not None
    for segment in capture.segments:
        track, truth = capture.track(segment), capture.ground_truth(segment)
        assert truth is not None
        rest = (capture.vertices(segment.start) - HEAD_ORIGIN)[mesh.follow == 1]
        for i, frame in enumerate(segment.frames):
            rigid = rest @ track.rotations[i].T + track.translations[i]
            moved = capture.vertices(frame)[mesh.follow == 1]
            assert np.quantile(np.abs(rigid - moved), 0.8) < 1e-6, "most of the head moves with its pose"
            for name in capture.camera_names:
                camera, view = capture.camera(frame, name), capture.view(frame, name)
                assert view.hair is not None
                points = torch.from_numpy(truth.strands[i]).reshape(-1, 3)
                pixels = camera.project(points)[0].floor().long().clamp(0, camera.width - 1)
                on_person = view.mask[pixels[:, 1], pixels[:, 0]] > 0
                assert on_person.float().mean() > 0.97
                assert (view.hair <= view.mask + 1e-6).all()
                landmarks = capture.landmarks_2d(frame, name)
                assert landmarks is not None
                expected = camera.project(torch.from_numpy(capture.landmarks_3d(frame)))[0]
                np.testing.assert_allclose(np.delete(landmarks, [48, 54], 0)[:, :2], expected, atol=1e-3)


def test_parallel_decoding_gives_what_serial_decoding_gives(pristine: Path) -> None:
    requests = [(f, n) for f in range(6) for n in ("00", "01")] * 2
    serial = [Capture.open(pristine).view(*request) for request in requests]
    capture = Capture.open(pristine)
    with ThreadPoolExecutor(4) as pool:
        answers = [*pool.map(capture.views, [requests] * 4), capture.views(requests)]
    for answer in answers:
        for found, expected in zip(answer, serial, strict=True):
            for field in ("rgb", "mask", "hair", "orientation", "coherence"):
                assert torch.equal(getattr(found, field), getattr(expected, field))


@pytest.mark.parametrize("kept", [0, 1, 3])
def test_the_memory_budget_is_kept(pristine: Path, kept: int) -> None:
    view_bytes = 40 * 40 * (3 + 1 + 1 + 2)
    capture = Capture.open(pristine, cache_bytes=kept * view_bytes + 10)
    expected = Capture.open(pristine)
    for frame in [0, 1, 2, 3, 4, 5, 0, 1, 5]:
        assert torch.equal(capture.view(frame, "00").rgb, expected.view(frame, "00").rgb)
        assert capture.cached_bytes <= capture.cache_bytes
    assert capture.cached_bytes == kept * view_bytes


def test_cameras_kept_are_few_however_long_a_capture_is(
    pristine: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dynhair.capture.reader._CACHED_CAMERAS", 4)
    capture, expected = Capture.open(pristine), Capture.open(pristine)
    for frame in [0, 1, 2, 3, 4, 5, 0, 5, 5]:
        for name in capture.camera_names:
            torch.testing.assert_close(capture.camera(frame, name).w2c, expected.camera(frame, name).w2c)
    assert capture._camera.cache_info().currsize == 4


def test_what_cannot_be_read_does_not_keep_the_rest_from_being_read(broken: Path) -> None:
    capture = Capture.open(broken)
    name, other = capture.camera_names[:2]
    damaged = capture.layout.find_image(capture.layout.frame_images(2), "mask", name)
    assert damaged is not None
    damaged.write_bytes(b"")
    error, view = capture.attempt_views(2, [name, other])
    assert isinstance(error, DynhairError)
    assert error.path == damaged
    assert isinstance(view, View)
    with pytest.raises(DynhairError, match=damaged.name):
        capture.views([(2, name), (2, other)])


def test_views_do_not_share_memory_with_the_cache(pristine: Path) -> None:
    capture = Capture.open(pristine)
    capture.view(0, "00").rgb.fill_(7)
    assert capture.view(0, "00").rgb.max() <= 1


def test_a_gaussian_head_avatar_folder_opens(pristine: Path, gha_folder: Path) -> None:
    capture = Capture.open(gha_folder)
    assert capture.segments == (Segment("all", 0, 6, "train"),)
    assert (capture.fps, capture.image_size, capture.camera_names) == (25.0, (40, 40), ("00", "01"))
    assert (capture.static_names, capture.mesh) == ((), None)
    view, original = capture.view(4, "01"), Capture.open(pristine).view(4, "01")
    assert (view.hair, view.orientation, view.coherence) == (None, None, None)
    assert (view.mask - original.mask).abs().mean() < 0.02
    assert view.rgb[original.mask == 0].mean() < 0.02, "the wall is gone"
    assert capture.landmarks_2d(0, "00") is None
    assert capture.ground_truth(capture.segments[0]) is None
    assert capture.track(capture.segments[0]).rotations.shape == (6, 3, 3)


def test_the_low_resolution_images_of_a_gaussian_head_avatar_folder(gha_folder: Path) -> None:
    full, low = Capture.open(gha_folder), Capture.open(gha_folder, lowres=True)
    assert low.image_size == (20, 20)
    assert low.view(0, "00").rgb.shape == (20, 20, 3)
    torch.testing.assert_close(low.camera(0, "00").K[:2] * 2, full.camera(0, "00").K[:2])
    torch.testing.assert_close(low.camera(0, "00").w2c, full.camera(0, "00").w2c)


def test_gaps_between_frames_end_a_segment(gha_folder: Path) -> None:
    shutil.rmtree(gha_folder / "images" / "0002")
    assert Capture.open(gha_folder).segments == (
        Segment("all-1", 0, 2, "train"),
        Segment("all-2", 3, 3, "train"),
    )


def test_a_map_that_one_view_lacks_is_an_error(broken: Path) -> None:
    (broken / "images" / "0001" / "hair_00.png").unlink()
    capture = Capture.open(broken)
    assert capture.view(0, "00").hair is not None
    with pytest.raises(DynhairError, match=r"hair_00"):
        capture.view(1, "00")


def test_a_map_that_every_view_lacks_is_none(broken: Path) -> None:
    for path in broken.rglob("orient_*.png"):
        path.unlink()
    view = Capture.open(broken).view(0, "00")
    assert (view.orientation, view.coherence) == (None, None)
    assert view.hair is not None


def test_bad_requests_are_explained(pristine: Path) -> None:
    capture = Capture.open(pristine)
    with pytest.raises(DynhairError, match=r"`stop`(.|\n)*turn or nod"):
        capture.segment("stop")
    with pytest.raises(DynhairError, match=r"00 or 01"):
        capture.view(0, "07")
    with pytest.raises(DynhairError, match=r"0099.*missing"):
        capture.view(99, "00")
    with pytest.raises(DynhairError, match=r"0099.*missing"):
        capture.camera(99, "00")
    with pytest.raises(DynhairError, match="no such folder"):
        Capture.open(pristine / "nowhere")
    with pytest.raises(DynhairError, match=r"capture\.json"):
        Capture.open(pristine / "gt")


def test_an_existing_folder_is_never_written_over(pristine: Path) -> None:
    manifest = Capture.open(pristine).manifest
    with pytest.raises(DynhairError, match="exists"), CaptureWriter.create(pristine, manifest):
        pass


def test_a_writer_that_fails_leaves_nothing(pristine: Path, tmp_path: Path) -> None:
    manifest = Capture.open(pristine).manifest

    def fail() -> None:
        with CaptureWriter.create(tmp_path / "c", manifest) as writer:
            writer.write_vertices(0, np.zeros((1, 3), np.float32))
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert list(tmp_path.iterdir()) == []


def test_the_example_of_the_manual_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    root = Path(__file__).parents[2]
    monkeypatch.chdir(root)
    section = (root / "docs" / "capture.md").read_text().partition("## Reading")[2]
    names: dict[str, object] = {}
    exec(section.partition("```python\n")[2].partition("```")[0], names)
    views = names["views"]
    assert isinstance(views, list)
    assert len(views) == 3
