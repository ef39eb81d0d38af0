"""Pictures of the open head with a painted face, for networks that know people.

Skin, lips, brows, eyes and a cap of hair are painted in the coordinates of the average head, so that the paint moves
with the surface through all identities and expressions.
"""

# Warp's annotations are calls, and its stubs do not declare the fields of a query.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import torch
from matplotlib.path import Path as Polygon
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation
from tools.ray_cast import RayCaster

from dynhair.camera import Camera
from dynhair.face import FaceModel

_SUPERSAMPLING = 2
_BROW_HALF_WIDTH = 0.0035  # metres, as the other lengths
_LASHES = 0.0012
_IRIS, _PUPIL = 0.0058, 0.0024
_OCCLUSION_RAYS, _OCCLUSION_REACH = 48, 0.05


@dataclass(frozen=True)
class Look:
    """What a picture of a head looks like.

    Attributes:
        skin: RGB in [0, 1], as the other colours.
        lips: of the lips.
        hair: of the scalp and the brows.
        iris: of the irises.
        light: direction to the key light, in the head's frame.
        ambient: light from everywhere, the key light having 1.
        background: behind the head.
    """

    skin: np.ndarray
    lips: np.ndarray
    hair: np.ndarray
    iris: np.ndarray
    light: np.ndarray
    ambient: float
    background: np.ndarray

    @classmethod
    def draw(cls, generator: np.random.Generator) -> Look:
        """A random look."""
        skin = np.array([0.87, 0.67, 0.56]) * generator.uniform(0.5, 1.05) * generator.uniform(0.95, 1.05, 3)
        light = Rotation.from_euler("yx", generator.uniform([-50, -60], [50, 0]), degrees=True).apply([0.0, 0.0, 1.0])
        return cls(
            skin=skin,
            lips=skin * np.array([0.85, 0.55, 0.58]),
            hair=np.array([0.25, 0.17, 0.12]) * generator.uniform(0.4, 1.6),
            iris=np.array([0.35, 0.3, 0.22]) * generator.uniform(0.5, 1.3, 3),
            light=light,
            ambient=generator.uniform(0.5, 0.9),
            background=np.full(3, generator.uniform(0.1, 0.8)),
        )


class HeadPainter:
    """Draws a head model whose eyeballs are meshes of their own."""

    def __init__(self, model: FaceModel) -> None:
        self.model = model
        self._mean = model.mean.numpy().astype(np.float64)
        self._faces = model.faces.numpy()
        landmarks = self._mean[model.landmarks68.numpy()]
        self._brows = KDTree(np.concatenate([_polyline(landmarks[17:22]), _polyline(landmarks[22:27])]))
        eyes = [_polyline(landmarks[[*range(start, start + 6), start]]) for start in (36, 42)]
        self._lashes = KDTree(np.concatenate(eyes))
        self._lips = Polygon(landmarks[48:60, :2]), Polygon(landmarks[60:68, :2])
        self._lips_back = float(landmarks[[48, 54], 2].min()) - 0.01

    def draw(self, vertices: np.ndarray, camera: Camera, look: Look) -> np.ndarray:
        """A picture of the head.

        Args:
            vertices: (V, 3) in the world, metres.
            camera: the view.
            look: colours and light.

        Returns:
            (H, W, 3) uint8.
        """
        caster = RayCaster(vertices, self._faces)
        step = 1 / _SUPERSAMPLING
        x = np.arange(step / 2, camera.width, step)
        y = np.arange(step / 2, camera.height, step)
        pixels = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
        faces, barycentric = caster.through_pixels(camera, pixels)
        hit = faces >= 0
        corners, weights = self._faces[faces[hit]], barycentric[hit]
        normals = _vertex_normals(vertices, self._faces)
        open_sky = _ambient_occlusion(caster, vertices, normals)
        at_hit = _interpolate(normals, corners, weights)
        diffuse = np.clip(at_hit @ look.light, 0, 1)
        shade = look.ambient * _interpolate(open_sky[:, None], corners, weights) + 0.6 * diffuse[:, None]
        colours = np.tile(look.background, (len(pixels), 1))
        colours[hit] = self._paint(faces[hit], _interpolate(self._mean, corners, weights), look) * shade
        image = colours.reshape(len(y) // _SUPERSAMPLING, _SUPERSAMPLING, -1, _SUPERSAMPLING, 3).mean((1, 3))
        return (np.clip(image, 0, 1) * 255).round().astype(np.uint8)

    def _paint(self, faces: np.ndarray, places: np.ndarray, look: Look) -> np.ndarray:
        """Colours of the surface: (n,) triangles hit, and (n, 3) where on the average head."""
        colours = np.tile(look.skin, (len(faces), 1))
        colours[np.isin(faces, self.model.scalp.numpy())] = look.hair
        colours[self._brows.query(places)[0] < _BROW_HALF_WIDTH] = look.hair
        outer, inner = self._lips
        in_front = places[:, 2] > self._lips_back
        flat = places[:, :2]
        colours[in_front & outer.contains_points(flat) & ~inner.contains_points(flat)] = look.lips
        colours[self._lashes.query(places)[0] < _LASHES] = look.hair * 0.5
        part = self._parts[faces]
        for eye in self._eyes:
            ball = part == eye
            pole = self._mean[self._vertex_parts == eye]
            front = pole[pole[:, 2].argmax()]
            away = np.linalg.norm(places[ball] - front, axis=1)
            white = np.full((ball.sum(), 3), 0.85)
            white[away < _IRIS] = look.iris
            white[away < _PUPIL] = 0.03
            colours[ball] = white
        colours[np.isin(part, self._hidden)] = [0.25, 0.1, 0.1]
        return colours

    @cached_property
    def _vertex_parts(self) -> np.ndarray:
        count = len(self._mean)
        edges = self._faces.ravel(), np.roll(self._faces, 1, axis=1).ravel()
        return connected_components(coo_matrix((np.ones(self._faces.size), edges), (count, count)), directed=False)[1]

    @cached_property
    def _parts(self) -> np.ndarray:
        return self._vertex_parts[self._faces[:, 0]]

    @cached_property
    def _eyes(self) -> list[int]:
        """Parts that lie behind the lids: their centres are within 2 cm of the middle of an eye's landmarks."""
        landmarks = self._mean[self.model.landmarks68.numpy()]
        middles = [landmarks[start : start + 6].mean(0) for start in (36, 42)]
        centres = [self._mean[self._vertex_parts == part].mean(0) for part in range(self._vertex_parts.max() + 1)]
        return [int(np.linalg.norm(np.array(centres) - middle, axis=1).argmin()) for middle in middles]

    @cached_property
    def _hidden(self) -> list[int]:
        """Parts within the mouth."""
        largest = int(np.bincount(self._vertex_parts).argmax())
        return [part for part in range(self._vertex_parts.max() + 1) if part != largest and part not in self._eyes]


def look_at(
    target: np.ndarray, yaw: float, pitch: float, roll: float, distance: float, focal: float, size: int
) -> Camera:
    """A camera that looks at a target.

    Args:
        target: (3,) in the middle of the picture.
        yaw: of the camera around the target, from +z towards +x, degrees.
        pitch: upwards, degrees.
        roll: of the camera around its axis, degrees.
        distance: to the target, metres.
        focal: in pixels.
        size: width and height in pixels.
    """
    turn = Rotation.from_euler("YXZ", [yaw, -pitch, roll], degrees=True).as_matrix()
    rotation = np.diag([1.0, -1.0, -1.0]) @ turn.T
    translation = np.array([0.0, 0.0, distance]) - rotation @ target
    intrinsics = np.array([[focal, 0, size / 2], [0, focal, size / 2], [0, 0, 1]])
    return Camera(
        torch.from_numpy(np.c_[rotation, translation]).float(), torch.from_numpy(intrinsics).float(), size, size
    )


def _ambient_occlusion(caster: RayCaster, vertices: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(V,) how much of the sky each vertex sees, with the cosine to its normal."""
    golden = np.pi * (3 - np.sqrt(5))
    index = np.arange(_OCCLUSION_RAYS) + 0.5
    radius, angle = np.sqrt(index / _OCCLUSION_RAYS), golden * index
    local = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - radius**2)], -1)
    helper = np.where(np.abs(normals[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]])
    tangent = np.cross(helper, normals)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    frame = np.stack([tangent, np.cross(normals, tangent), normals], 1)
    directions = np.einsum("rk,vkc->vrc", local, frame)
    starts = np.broadcast_to((vertices + 1e-4 * normals)[:, None], directions.shape)
    faces, _ = caster.cast(starts.reshape(-1, 3), directions.reshape(-1, 3), _OCCLUSION_REACH)
    return (faces.reshape(len(vertices), -1) < 0).mean(1)


def _interpolate(values: np.ndarray, corners: np.ndarray, weights: np.ndarray) -> np.ndarray:
    return np.einsum("nk,nkc->nc", weights, values[corners])


def _polyline(points: np.ndarray) -> np.ndarray:
    """Dense points along straight pieces."""
    steps = np.linspace(0, 1, 40)[:, None]
    return np.concatenate([a + steps * (b - a) for a, b in pairwise(points)])


def _vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = vertices[faces].swapaxes(0, 1)
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], np.cross(b - a, c - a))
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
