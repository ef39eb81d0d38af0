"""What can be chosen about the mesh head, the first stage of head and upper body (paper, appendix A)."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class MeshHeadWeights:
    """Weights of the mesh stage's terms; lengths are in canonical units of 0.1 m.

    Gaussian Head Avatar has 0.1, 0.1, 1, 0.01, 0.1 and 100, and no last one. Within some hundred steps colours shape a
    face only if they count more than silhouettes, and the neutral mesh stays in place only if deformations cost more.

    Attributes:
        image: of the mean absolute difference of colours.
        silhouette: of one less the intersection over union.
        landmarks: of the squared distance of deformed landmarks to tracked ones.
        deformation: of the squared displacement.
        surface: of the landmarks' distance to the surface.
        laplacian: of the uniform Laplacian's squared length in cubes of the grid, so that a coarser grid is smoothed no
            more for its vertices being further apart. The original's 100 on its own grid of 6.7 mm would be 0.45.
        departure: of the unevenness of the departure from the first shape.
    """

    image: float = 1.0
    silhouette: float = 0.1
    landmarks: float = 1.0
    deformation: float = 0.3
    surface: float = 0.1
    laplacian: float = 0.03
    departure: float = 0.1


@dataclass(frozen=True)
class MeshHeadConfig:
    """The mesh head and its training.

    Attributes:
        resolution: cubes of the tetrahedral grid along its longest side, which is about 0.6 m.
        width: size of the hidden layers of the geometry MLP and of the appearance MLP.
        layers: number of the geometry MLP's hidden layers.
        pretraining_iterations: steps that give the geometry MLP its first shape.
        iterations: steps that see images.
        views: views a step.
        image_size: longer side of the images, pixels; larger captures are reduced.
        refresh_every: steps between two looks at the whole grid for pieces of surface that are new.
        checkpoint_every: steps between checkpoints.
        network_rate: learning rate of the MLPs of geometry and deformation.
        appearance_rate: learning rate of the MLPs of appearance and colour.
        landmark_rate: learning rate of the canonical landmarks, metres.
        weights: of the losses.
    """

    resolution: int = 48
    width: int = 64
    layers: int = 5
    pretraining_iterations: int = 300
    iterations: int = 400
    views: int = 2
    image_size: int = 256
    refresh_every: int = 50
    checkpoint_every: int = 100
    network_rate: float = 3e-3
    appearance_rate: float = 5e-3
    landmark_rate: float = 1e-5
    weights: MeshHeadWeights = field(default_factory=MeshHeadWeights)
