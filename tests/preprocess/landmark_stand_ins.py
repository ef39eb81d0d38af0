"""Stand-ins for the landmark networks that see white discs as faces, and cameras to see them with."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from scipy.spatial import Delaunay
from scipy.spatial.transform import Rotation

from dynhair.camera import Camera
from dynhair.preprocess.landmarks.landmarker import FaceLandmarks
from dynhair.preprocess.landmarks.networks import FaceMesh, FaceNetworks

RIGHT_EYE, LEFT_EYE = 33, 263


def round_face() -> np.ndarray:
    """(478, 3) points on the near half of a unit sphere: x right, y down, z away from the camera."""
    generator = np.random.default_rng(0)
    radius, angle = 0.98 * np.sqrt(generator.uniform(size=478)), generator.uniform(0, 2 * np.pi, 478)
    flat = np.stack([radius * np.cos(angle), radius * np.sin(angle)], -1)
    flat[[RIGHT_EYE, LEFT_EYE]] = [-0.5, -0.2], [0.5, -0.2]
    flat[:4] = [-1, 0], [1, 0], [0, -1], [0, 1]
    return np.c_[flat, -np.sqrt(np.clip(1 - (flat**2).sum(1), 0, 1))]


def round_mesh() -> FaceMesh:
    face = round_face()[:468]
    triangles = Delaunay(face[:, :2]).simplices.astype(np.int64)
    a, b, c = face[triangles].swapaxes(0, 1)
    away = np.cross(b - a, c - a)[:, 2] > 0
    triangles[away] = triangles[away][:, ::-1]
    return FaceMesh((face * [1, -1, -1]).astype(np.float32), triangles)


def disc_networks(calls: list[str] | None = None) -> FaceNetworks:
    """Networks that find the white disc: its centre and radius are the round face's."""
    log = [] if calls is None else calls

    def boxes(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        log.append("boxes")
        regressors, logits = np.zeros((896, 16), np.float32), np.full(896, -20.0, np.float32)
        found = _disc(image > 0)
        if found is not None and found[1] > 0.12:
            centre, radius = found
            column, row = (np.clip(centre * 16, 0, 15)).astype(int)
            cell = (np.array([column, row]) + 0.5) / 16
            numbers = np.tile(centre - cell, (8, 1))
            numbers[1] = 2 * radius
            numbers[2:4] += [[-0.5 * radius, -0.2 * radius], [0.5 * radius, -0.2 * radius]]
            regressors[2 * (16 * row + column)] = (numbers * 128).ravel()
            logits[2 * (16 * row + column)] = 3.0
        return regressors, logits

    def points(crop: np.ndarray) -> tuple[np.ndarray, float]:
        log.append("points")
        found = _disc(crop > 0.5)
        if found is None:
            return np.zeros((478, 3), np.float32), -10.0
        centre, radius = found
        return ((round_face() * radius + [*centre, 0]) * 256).astype(np.float32), 5.0

    def blendshapes(chosen: np.ndarray) -> np.ndarray:
        log.append("blendshapes")
        return np.full(52, chosen.std() > 0, np.float32)

    return FaceNetworks(boxes, points, blendshapes, round_mesh())


def _disc(white: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Centre and radius of the white pixels in units of the square; None if there are but few or they are cut off."""
    mask = np.all(white, axis=-1)
    if mask.sum() < 20 or mask[[0, -1]].any() or mask[:, [0, -1]].any():
        return None
    y, x = np.nonzero(mask)
    return (np.array([x.mean(), y.mean()]) + 0.5) / len(mask), float(np.sqrt(mask.sum() / np.pi)) / len(mask)


def disc_image(centre: tuple[float, float], radius: float, size: tuple[int, int] = (200, 160)) -> np.ndarray:
    """A white disc on black; ``size`` is width and height."""
    x, y = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    inside = np.hypot(x - centre[0], y - centre[1]) < radius
    return np.repeat((255 * inside).astype(np.uint8)[..., None], 3, -1)


def ring_cameras(azimuths: list[float], distance: float = 1.0, focal: float = 250.0, size: int = 256) -> list[Camera]:
    """Cameras that look at the origin, from +z at azimuth 0 towards +x, in degrees."""
    cameras = []
    for azimuth in azimuths:
        turn = Rotation.from_euler("Y", azimuth, degrees=True).as_matrix()
        w2c = np.c_[np.diag([1.0, -1.0, -1.0]) @ turn.T, [0, 0, distance]]
        K = np.array([[focal, 0, size / 2], [0, focal, size / 2], [0, 0, 1]])
        cameras.append(Camera(torch.from_numpy(w2c).float(), torch.from_numpy(K).float(), size, size))
    return cameras


def seen_face(
    points: np.ndarray, camera: Camera, noise: Callable[[tuple[int, ...]], np.ndarray] | None = None
) -> FaceLandmarks:
    """What a perfect network would find of (478, 3) world points of which all are visible."""
    pixels, depths = camera.project(torch.from_numpy(points).float())
    flat = pixels.numpy().astype(np.float64)
    if noise is not None:
        flat = flat + noise(flat.shape)
    return FaceLandmarks(
        np.c_[flat, depths.numpy()].astype(np.float32), np.ones(478, np.float32), 1.0, np.zeros(52, np.float32)
    )
