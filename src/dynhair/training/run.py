"""A run on disk: its configuration, its stages' results, its checkpoint and its avatar."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import safetensors
import safetensors.torch
from jaxtyping import Float
from torch import Tensor

from dynhair.config import Config, read_config, write_config
from dynhair.errors import DynhairError
from dynhair.storage import atomic_file, atomic_folder, read_json, write_json

SCHEMA_VERSION = 2


@dataclass(frozen=True)
class Run:
    """The folder of one training.

    Attributes:
        path: the folder.
        capture: the capture that it trains on.
        config: everything else that determines the result.
        hair_init: a groom to start the canonical hair from; None for the strand prior's guess.
    """

    path: Path
    capture: Path
    config: Config
    hair_init: Path | None = None

    @classmethod
    def create(cls, path: Path, capture: Path, config: Config, hair_init: Path | None = None) -> Run:
        """Begin a run in a new or empty folder.

        Raises:
            DynhairError: something is there already.
        """
        if path.exists() and (not path.is_dir() or any(path.iterdir())):
            raise DynhairError(
                "there is something already",
                path=path,
                expected="a new or empty folder",
                mend="go on with the run there by --resume, or choose another folder by --out",
            )
        run = cls(path, capture.resolve(), config, None if hair_init is None else hair_init.resolve())
        with atomic_folder(path) as folder:
            write_config(config, folder / "config.yaml")
            description: dict[str, object] = {
                "kind": "dynhair run",
                "version": SCHEMA_VERSION,
                "capture": str(run.capture),
                "hair_init": None if run.hair_init is None else str(run.hair_init),
            }
            write_json(folder / "run.json", description)
        return run

    @classmethod
    def open(cls, path: Path) -> Run:
        """Open the folder of an earlier run.

        Raises:
            DynhairError: it is not one, or it is of another version.
        """
        if not (path / "run.json").exists():
            raise DynhairError(
                "there is no run to go on with",
                path=path,
                expected="a folder with run.json",
                mend="leave out --resume to begin a run there",
            )
        description = _description(path)
        groom = description.get("hair_init")
        return cls(
            path,
            Path(str(description.get("capture"))),
            read_config(path / "config.yaml"),
            None if groom is None else Path(str(groom)),
        )

    @property
    def checkpoint(self) -> Path:
        """The newest checkpoint."""
        return self.path / "checkpoint.safetensors"

    @property
    def avatar(self) -> Path:
        """The finished avatar."""
        return self.path / "avatar"

    @property
    def log(self) -> Path:
        """TensorBoard's folder."""
        return self.path / "log"

    @property
    def preview(self) -> Path:
        """The newest preview picture: truth above, avatar below."""
        return self.path / "preview.png"

    @property
    def encoders(self) -> Path:
        """The newest checkpoint of the strand prior's encoders."""
        return self.path / "static_encoders.safetensors"

    @property
    def moved_strands(self) -> Path:
        """The newest checkpoint of the canonical strands' displacements."""
        return self.path / "static_strands.safetensors"

    @property
    def hairstyle_preview(self) -> Path:
        """The canonical hair in every view, beside the truth."""
        return self.path / "hairstyle.png"

    @property
    def canonical_hair(self) -> Path:
        """The static stage's result."""
        return self.path / "canonical_hair.safetensors"

    @property
    def first_guess(self) -> Path:
        """What the prior's encoders made of the views before they were trained on them, or the groom from a file."""
        return self.path / "first_guess.safetensors"


def read_hair(path: Path) -> Float[Tensor, "n l 3"] | None:
    """Read the strands that a stage kept, head frame, metres; None if it has not got so far.

    Raises:
        DynhairError: the file is damaged.
    """
    if not path.exists():
        return None
    try:
        return safetensors.torch.load_file(path)["strands"]
    except (OSError, KeyError, safetensors.SafetensorError) as error:
        raise DynhairError(
            f"not readable ({error})", path=path, mend="delete it: the stage will be done again"
        ) from None


def write_hair(strands: Float[Tensor, "n l 3"], path: Path) -> None:
    """Keep strands, atomically."""
    with atomic_file(path) as temporary:
        safetensors.torch.save_file({"strands": strands.detach().contiguous()}, temporary)


def avatar_folder(path: Path) -> Path:
    """The avatar's folder, given that or the folder of the run that made it."""
    return path / "avatar" if (path / "run.json").exists() else path


def trained_capture(path: Path) -> Path:
    """The capture that an avatar was trained on, given the run's folder or the avatar's inside it.

    Raises:
        DynhairError: the avatar lies outside its run.
    """
    for folder in (path, path.resolve().parent):
        if (folder / "run.json").exists():
            return Path(str(_description(folder).get("capture")))  # whatever settings the run's release had
    raise DynhairError(
        "the avatar is not in its run's folder, so its capture is not known", path=path, mend="name it by --capture"
    )


def _description(path: Path) -> dict[str, Any]:
    """What a run's folder says of itself."""
    description = read_json(path / "run.json")
    if description.get("kind") != "dynhair run" or description.get("version") != SCHEMA_VERSION:
        raise DynhairError(
            f"kind {description.get('kind')!r}, version {description.get('version')!r}",
            path=path / "run.json",
            expected=f"a 'dynhair run' of version {SCHEMA_VERSION}",
            mend="resume it with the release that began it",
        )
    return description
