"""The surface of head and shoulders as a mesh, which an avatar keeps for the programs that it is exported to."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import safetensors
import safetensors.torch
import torch
from jaxtyping import Float, Int64
from torch import Tensor

from dynhair.errors import DynhairError

HEAD_MESH = "head_mesh.safetensors"
"""In the avatar's folder; an avatar without it is whole."""


@dataclass(frozen=True)
class HeadMesh:
    """The surface of head and shoulders in the frame in which the hair is at rest.

    Attributes:
        vertices: head frame, metres.
        faces: triangles, counter-clockwise seen from outside.
    """

    vertices: Float[Tensor, "v 3"]
    faces: Int64[Tensor, "f 3"]

    def to_tensors(self) -> dict[str, Tensor]:
        """Return the tensors that :meth:`read` reads back."""
        return {"vertices": self.vertices.float(), "faces": self.faces.int()}

    @classmethod
    def read(cls, folder: Path) -> HeadMesh | None:
        """The mesh in an avatar's folder; None where there is none.

        Raises:
            DynhairError: the file is damaged, or holds no mesh.
        """
        path = folder / HEAD_MESH
        if not path.exists():
            return None
        mend = "write the folder again, or remove the file: then the mesh is taken from the training capture"
        try:
            tensors = safetensors.torch.load_file(path)
        except (OSError, safetensors.SafetensorError) as error:
            raise DynhairError(f"not readable as safetensors ({error})", path=path, mend=mend) from None
        vertices, faces = (tensors.get(name, torch.empty(0)) for name in ("vertices", "faces"))
        if not _is_mesh(vertices, faces):
            raise DynhairError(
                f"holds `vertices` {tuple(vertices.shape)} and `faces` {tuple(faces.shape)} that are no mesh",
                path=path,
                expected="finite vertices (V, 3), and triangles (F, 3) of their indices",
                mend=mend,
            )
        return cls(vertices.float(), faces.long())


def _is_mesh(vertices: Tensor, faces: Tensor) -> bool:
    if vertices.shape[1:] != (3,) or faces.shape[1:] != (3,) or not len(faces):
        return False
    if not vertices.is_floating_point() or faces.dtype not in (torch.int32, torch.int64):
        return False
    return bool(vertices.isfinite().all() and faces.min() >= 0 and faces.max() < len(vertices))
