"""Marching tetrahedra: seconds and memory beside scikit-image's marching cubes, and what the lattice is worth.

    python benchmarks/marching.py [--json FILE]

Marching cubes, which has no gradients, is given as many samples of the same sphere. The lattices draw spheres and tori,
upright and aslant; errors are root mean squares over the area.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import resource
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from itertools import permutations
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # before torch starts its threads

import torch
from skimage.measure import marching_cubes
from torch import Tensor
from torch.nn.functional import normalize

from dynhair.mesh import TetrahedralGrid, marching_tetrahedra

RESOLUTIONS = (32, 52, 64, 128)
REPEATS = 3
RADIUS = 0.63  # of the box's half side, about as a head fills it
MEBIBYTE = 2**20


@dataclass(frozen=True)
class Speed:
    """One grid; times in milliseconds of the processor."""

    resolution: int
    vertices: int
    tetrahedra: int
    faces: int
    make: float
    forward: float
    backward: float
    marching_cubes: float
    grid_memory: float  # MiB
    peak_memory: float  # MiB, of the process so far


@dataclass(frozen=True)
class Quality:
    """One lattice."""

    lattice: str
    vertices: int
    faces: float
    distance: float  # thousandths of the box's half side
    normal: float  # degrees


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, help="write the figures there")
    arguments = parser.parse_args()

    torch.set_num_threads(1)
    print(
        f"{'cubes':>6}{'vertices':>10}{'tetrahedra':>12}{'faces':>9}{'make ms':>9}{'forward':>9}{'backward':>10}",
        end="",
    )
    print(f"{'m. cubes':>10}{'grid MiB':>10}{'peak MiB':>10}")
    speeds = []
    for resolution in RESOLUTIONS:
        speed = measure(resolution)
        speeds.append(speed)
        print(
            f"{resolution:6}{speed.vertices:10}{speed.tetrahedra:12}{speed.faces:9}{speed.make:9.0f}{speed.forward:9.0f}"
            f"{speed.backward:10.0f}{speed.marching_cubes:10.0f}{speed.grid_memory:10.0f}{speed.peak_memory:10.0f}"
        )
    print(f"{'lattice':16}{'vertices':>10}{'faces':>9}{'distance':>10}{'normals':>9}")
    lattices = {"body-centred": (unit_box(38).vertices, unit_box(38).tetrahedra), "Kuhn": kuhn_lattice(48)}
    qualities = [quality(name, *lattice) for name, lattice in lattices.items()]
    for each in qualities:
        print(f"{each.lattice:16}{each.vertices:10}{each.faces:9.0f}{each.distance:10.3f}{each.normal:9.2f}")
    if arguments.json:
        figures = {"speeds": [asdict(each) for each in speeds], "lattices": [asdict(each) for each in qualities]}
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")


def measure(resolution: int) -> Speed:
    make = milliseconds(lambda: unit_box(resolution, torch.float32))
    grid = unit_box(resolution, torch.float32)
    positions = grid.vertices.clone().requires_grad_()
    sdf = (grid.vertices.norm(dim=1) - RADIUS).requires_grad_()

    def march() -> Tensor:
        return marching_tetrahedra(positions, sdf, grid.tetrahedra).vertices

    forward = milliseconds(march)
    both = milliseconds(lambda: march().square().sum().backward())
    side = torch.linspace(-1, 1, round(len(grid.vertices) ** (1 / 3)))
    samples = (torch.cartesian_prod(side, side, side).norm(dim=1) - RADIUS).reshape(3 * [len(side)]).numpy()
    return Speed(
        resolution=resolution,
        vertices=len(grid.vertices),
        tetrahedra=len(grid.tetrahedra),
        faces=len(marching_tetrahedra(grid.vertices, sdf.detach(), grid.tetrahedra).faces),
        make=make,
        forward=forward,
        backward=both - forward,
        marching_cubes=milliseconds(lambda: marching_cubes(samples, 0.0)),
        grid_memory=(grid.vertices.nbytes + grid.tetrahedra.nbytes) / MEBIBYTE,
        peak_memory=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10),
    )


def milliseconds(work: Callable[[], object]) -> float:
    times = []
    for _ in range(REPEATS):
        start = time.thread_time()
        work()
        times.append(1e3 * (time.thread_time() - start))
    return statistics.median(times)


def unit_box(resolution: int, dtype: torch.dtype = torch.float64) -> TetrahedralGrid:
    high = torch.ones(3, dtype=dtype)
    return TetrahedralGrid.of(-high, high, resolution)


def kuhn_lattice(resolution: int) -> tuple[Tensor, Tensor]:
    """Six tetrahedra to a cube, each along a path from its least corner to its greatest, one axis after another."""
    ticks = torch.arange(resolution + 1)
    cubes = torch.cartesian_prod(ticks[:-1], ticks[:-1], ticks[:-1])
    strides = torch.tensor([(resolution + 1) ** 2, resolution + 1, 1])
    tetrahedra = []
    for axes in permutations(range(3)):
        path = torch.cat([torch.zeros(1, 3, dtype=torch.int64), torch.eye(3, dtype=torch.int64)[list(axes)].cumsum(0)])
        if torch.linalg.det(path[1:].double()) < 0:
            path = path[[0, 2, 1, 3]]
        tetrahedra.append(((cubes[:, None] + path) * strides).sum(2))
    return torch.cartesian_prod(ticks, ticks, ticks).double() * 2 / resolution - 1, torch.cat(tetrahedra)


def quality(name: str, positions: Tensor, tetrahedra: Tensor) -> Quality:
    aslant = torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(3)).double())[0]
    figures = []
    for shape in (sphere_distance, torus_distance):
        for turn in (torch.eye(3).double(), aslant):
            figures.append(errors(lambda points, s=shape, t=turn: s(points @ t.T + 0.01), positions, tetrahedra))
    faces, distance, normal = (statistics.mean(column) for column in zip(*figures, strict=True))
    return Quality(name, len(positions), faces, 1e3 * distance, math.degrees(normal))


def errors(shape: Callable[[Tensor], Tensor], positions: Tensor, tetrahedra: Tensor) -> tuple[int, float, float]:
    """Number of faces, distance of their centres and angle of their normals, radians."""
    surface = marching_tetrahedra(positions, shape(positions), tetrahedra)
    a, b, c = surface.vertices[surface.faces].unbind(1)
    normals = torch.linalg.cross(b - a, c - a)
    areas, centres = normals.norm(dim=1), ((a + b + c) / 3).requires_grad_()
    distances = shape(centres)
    (true_normals,) = torch.autograd.grad(distances.sum(), centres)
    angles = (normalize(normals, dim=1, eps=1e-30) * normalize(true_normals, dim=1)).sum(1).clamp(-1, 1).acos()
    weights = areas / areas.sum()
    squares = [(weights * value.detach().square()).sum().sqrt().item() for value in (distances, angles)]
    return len(surface.faces), squares[0], squares[1]


def sphere_distance(points: Tensor) -> Tensor:
    return points.norm(dim=1) - RADIUS


def torus_distance(points: Tensor) -> Tensor:
    return torch.hypot(points[:, [0, 2]].norm(dim=1) - 0.55, points[:, 1]) - 0.22


if __name__ == "__main__":
    main()
