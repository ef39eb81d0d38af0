from __future__ import annotations

import numpy as np
from landmark_stand_ins import disc_image, disc_networks, ring_cameras

from dynhair.preprocess.landmarks import FaceLandmarker, FaceTrack, track_landmarks

BLACK = np.zeros((256, 256, 3), np.uint8)


def ball_images(azimuths: list[float], place: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> list[np.ndarray]:
    """What ring cameras see of a white ball; seen from afar, so that its outline is a disc."""
    import torch

    images = []
    for camera in far_cameras(azimuths):
        pixel, depth = camera.project(torch.tensor(place))
        images.append(disc_image((float(pixel[0]), float(pixel[1])), 0.1 * 2500 / float(depth), (256, 256)))
    return images


def far_cameras(azimuths: list[float]) -> list:
    return ring_cameras(azimuths, distance=10.0, focal=2500.0)


def test_one_camera_follows_and_recovers():
    calls: list[str] = []
    landmarker = FaceLandmarker(disc_networks(calls))
    images = [disc_image((60 + 5 * i, 80), 25) for i in range(4)]
    images.insert(2, np.zeros_like(images[0]))
    faces, searches = [], []
    for face in track_landmarks(images, landmarker):
        faces.append(face)
        searches.append(calls.count("boxes"))
        calls.clear()
    assert [face is not None for face in faces] == [True, True, False, True, True]
    assert searches[1] == searches[4] == 0
    assert min(searches[0], searches[2], searches[3]) > 0


def test_views_that_are_close_together_check_one_another():
    # The stand-in's points lie on the outline's disc, so only views from nearly the same side agree.
    azimuths = [-1.0, 0.0, 1.0]
    cameras = far_cameras(azimuths)
    track = FaceTrack(FaceLandmarker(disc_networks()))
    images = ball_images(azimuths)
    assert all(track.follow(images, cameras))
    images[1] = disc_image((60, 200), 20, (256, 256))  # a face that is somewhere else
    found = track.follow(images, cameras)
    assert [face is not None for face in found] == [True, False, True]


def test_the_same_face_seen_a_little_elsewhere_is_kept_for_tracking_to_judge():
    azimuths = [-1.0, 0.0, 1.0]
    cameras = far_cameras(azimuths)
    images = ball_images(azimuths)
    images[1] = np.roll(images[1], 8, axis=1)  # a camera out of step, or badly calibrated
    found = FaceTrack(FaceLandmarker(disc_networks())).follow(images, cameras)
    assert found[1] is not None
    np.testing.assert_allclose(found[1].square.centre, [136, 128], atol=1)


def test_a_view_is_helped_by_the_others():
    azimuths = [-1.0, 0.0, 1.0]
    cameras = far_cameras(azimuths)
    calls: list[str] = []
    networks = disc_networks(calls)
    landmarker = FaceLandmarker(networks)
    first = landmarker.detect
    images = ball_images(azimuths)
    blind = images[1]

    def detect(image, hint=None):
        return None if image is blind else first(image, hint)

    landmarker.detect = detect
    found = FaceTrack(landmarker).follow(images, cameras)
    assert all(face is not None for face in found)
    assert found[1] is not None
    np.testing.assert_allclose(found[1].square.centre, [128, 128], atol=1)


def test_nothing_anywhere():
    track = FaceTrack(FaceLandmarker(disc_networks()))
    assert track.follow([BLACK, BLACK], far_cameras([0, 1])) == [None, None]


def test_frames_are_searched_only_when_the_face_was_lost():
    azimuths = [-1.0, 1.0]
    cameras, calls = far_cameras(azimuths), []
    track = FaceTrack(FaceLandmarker(disc_networks(calls)))
    track.follow(ball_images(azimuths), cameras)
    assert "boxes" in calls
    calls.clear()
    assert all(track.follow(ball_images(azimuths, (0.01, 0.0, 0.0)), cameras))
    assert "boxes" not in calls


def test_a_single_camera_needs_no_other():
    (camera,) = far_cameras([0])
    track = FaceTrack(FaceLandmarker(disc_networks()))
    assert track.follow(ball_images([0]), [camera])[0] is not None
    assert track.follow([BLACK], [camera]) == [None]
