"""Mesh decimation that only drops vertices, so that one choice of vertices serves every frame of a moving mesh.

Half-edge collapses ordered by quadric error (Garland and Heckbert, "Surface simplification using quadric error
metrics", 1997), summed over several poses: a vertex is merged into a neighbour, never moved.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable

import numpy as np

_MIN_NORMAL_COSINE = 0.2
_BOUNDARY_WEIGHT = 10.0


def decimate(
    poses: np.ndarray, faces: np.ndarray, target: int, *, locked: Iterable[int] = (), weights: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Choose ``target`` vertices of a manifold mesh and the faces between them.

    Args:
        poses: (P, V, 3) positions in a few poses.
        faces: (F, 3) vertex indices.
        target: how many vertices to keep.
        locked: vertices to keep in any case.
        weights: (V,) how much an error near each vertex counts; 1 by default.

    Returns:
        Indices of the vertices kept, sorted; and (F, 3) faces in the old indices, with (-1, -1, -1) for the faces that
        are gone, so that labels of faces carry over.
    """
    mesh = _Mesh(poses, faces, np.ones(poses.shape[1]) if weights is None else weights)
    fixed = set(map(int, locked))
    heap: list[tuple[float, int, int, int, int]] = []

    def push(a: int, b: int) -> None:
        for u, v in ((a, b), (b, a)):
            if u not in fixed:
                heapq.heappush(heap, (mesh.cost(u, v), u, v, mesh.stamp[u], mesh.stamp[v]))

    for a in list(mesh.neighbours):
        for b in mesh.neighbours[a]:
            if a < b:
                push(a, b)
    while len(mesh.neighbours) > target and heap:
        _, u, v, stamp_u, stamp_v = heapq.heappop(heap)
        current = u in mesh.neighbours and v in mesh.neighbours and (stamp_u, stamp_v) == (mesh.stamp[u], mesh.stamp[v])
        if current and mesh.may_collapse(u, v):
            mesh.collapse(u, v)
            for w in mesh.neighbours[v]:
                push(v, w)
    return np.array(sorted(mesh.neighbours)), mesh.faces


class _Mesh:
    def __init__(self, poses: np.ndarray, faces: np.ndarray, weights: np.ndarray) -> None:
        self.poses = poses.astype(np.float64)
        self.faces = faces.astype(np.int64).copy()
        self.stamp = [0] * poses.shape[1]
        self.faces_of: dict[int, set[int]] = {}
        for f, corners in enumerate(self.faces.tolist()):
            for vertex in corners:
                self.faces_of.setdefault(vertex, set()).add(f)
        self.neighbours = {v: self._around(v) for v in self.faces_of}
        self.boundary = {v for v in self.faces_of if len(self.faces_of[v]) != len(self.neighbours[v])}
        self.quadrics = self._quadrics() * weights[:, None, None]

    def _around(self, vertex: int) -> set[int]:
        return {int(w) for f in self.faces_of[vertex] for w in self.faces[f]} - {vertex}

    def _quadrics(self) -> np.ndarray:
        """(P, V, 4, 4), weighted by area; a plane at right angles holds each boundary edge in its place."""
        quadrics = np.zeros((*self.poses.shape[:2], 4, 4))
        corners = self.poses[:, self.faces]
        normals = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
        areas = np.linalg.norm(normals, axis=-1, keepdims=True)
        normals = normals / np.maximum(areas, 1e-20)
        planes = _planes(normals, corners[:, :, 0], areas)
        for f, face in enumerate(self.faces):
            quadrics[:, face] += planes[:, f, None]
        for f, face in enumerate(self.faces):
            for k in range(3):
                a, b = int(face[k]), int(face[(k + 1) % 3])
                if len(self.faces_of[a] & self.faces_of[b]) == 1:
                    edge = self.poses[:, b] - self.poses[:, a]
                    across = np.cross(edge, normals[:, f])
                    length = np.linalg.norm(across, axis=-1, keepdims=True)
                    walls = _planes(across / np.maximum(length, 1e-20), self.poses[:, a], _BOUNDARY_WEIGHT * length**2)
                    quadrics[:, a] += walls
                    quadrics[:, b] += walls
        return quadrics

    def cost(self, u: int, v: int) -> float:
        """Error of merging ``u`` into ``v``; very short edges go first where the surface is flat."""
        point = np.append(self.poses[:, v], np.ones((len(self.poses), 1)), 1)
        error = np.einsum("pi,pij,pj->", point, self.quadrics[:, u] + self.quadrics[:, v], point)
        return float(error + 1e-12 * np.square(self.poses[0, u] - self.poses[0, v]).sum())

    def may_collapse(self, u: int, v: int) -> bool:
        shared = self.faces_of[u] & self.faces_of[v]
        if u in self.boundary and (v not in self.boundary or len(shared) != 1):
            return False
        if len(self.neighbours[u] & self.neighbours[v]) != len(shared):
            return False  # would pinch the surface
        kept = self.faces[list(self.faces_of[u] - shared)]
        if len(kept) == 0:
            return False
        before, after = self.poses[:, kept], self.poses[:, np.where(kept == u, v, kept)]
        old, new = (np.cross(x[:, :, 1] - x[:, :, 0], x[:, :, 2] - x[:, :, 0]) for x in (before, after))
        size = np.linalg.norm(old, axis=-1) * np.linalg.norm(new, axis=-1)
        return bool(((old * new).sum(-1) > _MIN_NORMAL_COSINE * size).all())

    def collapse(self, u: int, v: int) -> None:
        shared = self.faces_of[u] & self.faces_of[v]
        touched = self.neighbours[u] | self.neighbours[v]
        for f in shared:
            for vertex in self.faces[f]:
                self.faces_of[int(vertex)].discard(f)
            self.faces[f] = -1
        for f in self.faces_of.pop(u):
            self.faces[f][self.faces[f] == u] = v
            self.faces_of[v].add(f)
        self.quadrics[:, v] += self.quadrics[:, u]
        del self.neighbours[u]
        self.stamp[v] += 1
        for vertex in touched - {u}:
            self.neighbours[vertex] = self._around(vertex)


def _planes(normals: np.ndarray, points: np.ndarray, weights: np.ndarray) -> np.ndarray:
    planes = np.concatenate([normals, -(normals * points).sum(-1, keepdims=True)], -1)
    return weights[..., None] * planes[..., :, None] * planes[..., None, :]
