"""Symmetric systems whose unknowns come in blocks, each coupled with the next few."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.linalg import cho_solve_banded, cholesky_banded


@dataclass(frozen=True)
class BlockBanded:
    """A symmetric matrix of square blocks.

    Attributes:
        blocks: ``blocks[t, d]`` is the block in row ``t + d`` and column ``t``, that is how block ``t + d`` depends on
            block ``t``; blocks of rows beyond the last are nought.
    """

    blocks: Float[ndarray, "f d u u"]

    def damped(self, damping: float) -> BlockBanded:
        """With the diagonal raised by a factor."""
        blocks = self.blocks.copy()
        diagonal = np.arange(blocks.shape[-1])
        blocks[:, 0, diagonal, diagonal] *= 1 + damping
        return BlockBanded(blocks)

    def factorised(self) -> BandedCholesky:
        """Its Cholesky factor.

        Raises:
            numpy.linalg.LinAlgError: it is not positive definite.
        """
        frames, width, size, _ = self.blocks.shape
        distance, row, column = np.meshgrid(np.arange(width), np.arange(size), np.arange(size), indexing="ij")
        below = distance * size + row - column
        lower = below >= 0
        band = np.zeros((width * size, frames, size))
        band[below[lower], :, column[lower]] = np.moveaxis(self.blocks[:, lower], 0, 1)
        return BandedCholesky(cholesky_banded(band.reshape(width * size, -1), lower=True, check_finite=False), size)

    def dense(self) -> Float[ndarray, "fu fu"]:
        """The whole matrix."""
        frames, width, size, _ = self.blocks.shape
        matrix = np.zeros((frames, size, frames, size))
        for distance in range(min(width, frames)):
            t = np.arange(frames - distance)
            block = self.blocks[: frames - distance, distance]
            matrix[t + distance, :, t] = block
            matrix[t, :, t + distance] = block.swapaxes(-1, -2)
        return matrix.reshape(frames * size, frames * size)


@dataclass(frozen=True)
class BandedCholesky:
    """A factorised ``BlockBanded``.

    Attributes:
        band: the lower factor in LAPACK's banded storage.
        size: of the blocks.
    """

    band: Float[ndarray, "b fu"]
    size: int

    def solve(self, right: Float[ndarray, "f u *r"]) -> Float[ndarray, "f u *r"]:
        """Solutions for one or several right-hand sides."""
        flat = right.reshape(right.shape[0] * right.shape[1], *right.shape[2:])
        return cho_solve_banded((self.band, True), flat, check_finite=False).reshape(right.shape)

    def log_determinant(self) -> float:
        """Of the matrix, not of its factor."""
        return 2 * float(np.log(self.band[0]).sum())
