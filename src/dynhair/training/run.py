"""A run on disk: its configuration, its stages' results, its checkpoint and its avatar."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import safetensors
import safetensors.torch
from jaxtyping import Float
from torch import Tensor

from dynhair.config import Config, read_config, write_config
from dynhair.errors import DynhairError
from dynhair.storage import atomic_file, atomic_folder, read_json, write_json

SCHEMA_VERSION = 1


@dataclass(frozen=True)
class Run:
    """The folder of one training.

    Attributes:
        path: the folder.
        capture: the capture that it trains on.
        config: everything else that determines the result.
    """

    path: Path
    capture: Path
    config: Config

    @classmethod
    def create(cls, path: Path, capture: Path, config: Config) -> Run:
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
        run = cls(path, capture.resolve(), config)
        with atomic_folder(path) as folder:
            write_config(config, folder / "config.yaml")
            description = {"kind": "dynhair run", "version": SCHEMA_VERSION, "capture": str(run.capture)}
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
        description = read_json(path / "run.json")
        if description.get("kind") != "dynhair run" or description.get("version") != SCHEMA_VERSION:
            raise DynhairError(
                f"kind {description.get('kind')!r}, version {description.get('version')!r}",
                path=path / "run.json",
                expected=f"a 'dynhair run' of version {SCHEMA_VERSION}",
                mend="resume it with the release that began it",
            )
        return cls(path, Path(str(description.get("capture"))), read_config(path / "config.yaml"))

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
    def _canonical_hair(self) -> Path:
        return self.path / "canonical_hair.safetensors"

    def read_canonical_hair(self) -> Float[Tensor, "n l 3"] | None:
        """The static stage's strands in the head frame, metres; None before that stage is done.

        Raises:
            DynhairError: the file is damaged.
        """
        if not self._canonical_hair.exists():
            return None
        try:
            return safetensors.torch.load_file(self._canonical_hair)["strands"]
        except (OSError, KeyError, safetensors.SafetensorError) as error:
            raise DynhairError(
                f"not readable ({error})", path=self._canonical_hair, mend="delete it: the stage will be done again"
            ) from None

    def write_canonical_hair(self, strands: Float[Tensor, "n l 3"]) -> None:
        """Keep the static stage's strands."""
        with atomic_file(self._canonical_hair) as temporary:
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
            return Run.open(folder).capture
    raise DynhairError(
        "the avatar is not in its run's folder, so its capture is not known", path=path, mend="name it by --capture"
    )
