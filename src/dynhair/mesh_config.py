"""What can be chosen about the mesh head, the first stage of head and upper body (paper, appendix A)."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class MeshHeadWeights:
    """Weights of the mesh stage's terms, Gaussian Head Avatar's; lengths are in canonical units of 0.1 m.

    Attributes:
        image: of the mean absolute difference of colours.
        silhouette: of one less the intersection over union.
        landmarks: of the squared distance of deformed landmarks to tracked ones.
        deformation: of the squared displacement.
        surface: of the landmarks' distance to the surface.
        laplacian: of the uniform Laplacian's squared length in cubes of the grid, so that a coarser grid is smoothed no
            more for its vertices being further apart. 0.45 is the original's 100 on its own grid of cubes of 6.7 mm.
        departure: of the squared gradient of the departure from the first shape; beyond the paper.
    """

    image: float = 0.1
    silhouette: float = 0.1
    landmarks: float = 1.0
    deformation: float = 0.1
    surface: float = 0.1
    laplacian: float = 0.1
    departure: float = 0.1


@dataclass(frozen=True)
class MeshHeadConfig:
    """The mesh head and its training.

    Attributes:
        resolution: cubes of the tetrahedral grid along its longest side.
        width: size of the geometry MLP's hidden layers.
        layers: their number.
        pretraining_iterations: steps that give the geometry MLP its first shape.
        iterations: steps that see images.
        views: views a step.
        image_size: longer side of the images, pixels; larger captures are reduced.
        refresh_every: steps between two looks at the whole grid; between them only the surface's surroundings count.
        checkpoint_every: steps between checkpoints.
        network_rate: learning rate of the MLPs.
        landmark_rate: learning rate of the canonical landmarks, metres.
        weights: of the losses.
    """

    resolution: int = 64
    width: int = 64
    layers: int = 5
    pretraining_iterations: int = 300
    iterations: int = 600
    views: int = 4
    image_size: int = 256
    refresh_every: int = 10
    checkpoint_every: int = 100
    network_rate: float = 2e-3
    landmark_rate: float = 1e-5
    weights: MeshHeadWeights = field(default_factory=MeshHeadWeights)
