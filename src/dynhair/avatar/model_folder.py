"""A trained head on disk: ``avatar.json`` says what it is, ``avatar.safetensors`` holds its tensors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import safetensors
import safetensors.torch
import torch
from torch import Tensor, nn

from dynhair.capture import ExpressionBasis
from dynhair.errors import DynhairError
from dynhair.storage import atomic_folder, read_json, write_json

DESCRIPTION = "avatar.json"
TENSORS = "avatar.safetensors"

M = TypeVar("M", bound=nn.Module)


def save_model(
    model: nn.Module,
    path: Path | str,
    kind: str,
    description: Mapping[str, Any],
    *,
    version: int = 1,
    further: Mapping[str, Mapping[str, Tensor]] | None = None,
) -> None:
    """Write a model as a folder, atomically.

    Args:
        model: whose tensors are kept.
        path: the folder.
        kind: what it is.
        description: what else is needed to build a model that the tensors fit, as JSON values.
        version: of the kind.
        further: names of other files of tensors, with what they hold.

    Raises:
        DynhairError: it cannot be written.
    """
    files = {TENSORS: model.state_dict(), **(further or {})}
    try:
        with atomic_folder(path) as folder:
            write_json(folder / DESCRIPTION, {"kind": kind, "version": version, **description})
            for name, tensors in files.items():
                kept = {key: value.detach().cpu().contiguous() for key, value in tensors.items()}
                safetensors.torch.save_file(kept, folder / name)
    except (OSError, safetensors.SafetensorError) as error:
        raise DynhairError(
            f"the avatar cannot be written ({error}); the checkpoint of a run has all of it",
            path=path,
            mend="free some space, and go on with the run by --resume",
        ) from error


def load_model(
    path: Path | str,
    kind: str,
    like: Callable[[Mapping[str, Any], Mapping[str, Tensor]], M],
    device: torch.device | str,
    *,
    version: int = 1,
) -> M:
    """Open a model's folder. Nothing in it is executed.

    Args:
        path: the folder.
        kind: what it must be.
        like: builds a model that the tensors fit from the description and, for their sizes, the tensors.
        device: where the model goes.
        version: of the kind.

    Raises:
        DynhairError: a file is missing, damaged, of another kind or version, or does not fit the other.
    """
    path = Path(path)
    description = read_description(path, kind, version)
    tensors = read_tensors(path)
    try:
        model = like(description, tensors)
        model.load_state_dict(tensors)
    except (KeyError, TypeError, ValueError, IndexError, RuntimeError, AttributeError) as error:
        raise DynhairError(
            f"the tensors do not fit {DESCRIPTION}: {error}", path=path / TENSORS, mend="write the folder again"
        ) from None
    return model.to(device).eval()


def read_description(path: Path, kind: str, version: int) -> dict[str, Any]:
    """Read what a folder says of itself.

    Raises:
        DynhairError: there is no such folder, or it is of another kind or version.
    """
    if not path.is_dir():
        raise DynhairError("there is no such folder", path=path, expected=f"the folder of a '{kind}'")
    description = read_json(path / DESCRIPTION)
    if description.get("kind") != kind or description.get("version") != version:
        raise DynhairError(
            f"kind {description.get('kind')!r}, version {description.get('version')!r}",
            path=path / DESCRIPTION,
            expected=f"a '{kind}' of version {version}",
            mend="open it with the release that wrote it",
        )
    return description


def read_tensors(path: Path) -> dict[str, Tensor]:
    """Read a folder's tensors.

    Raises:
        DynhairError: their file is missing or damaged.
    """
    try:
        return safetensors.torch.load_file(path / TENSORS)
    except FileNotFoundError:
        raise DynhairError("the file is missing", path=path / TENSORS) from None
    except (OSError, safetensors.SafetensorError) as error:
        raise DynhairError(f"not readable as safetensors ({error})", path=path / TENSORS) from None


def basis_of(description: Mapping[str, Any]) -> ExpressionBasis | None:
    """The expression basis that a description names."""
    basis = description["expression_basis"]
    return None if basis is None else ExpressionBasis(basis["name"], tuple(basis.get("names", ())))
