"""The folders of rows: how they begin, what they share, when they are done."""

from __future__ import annotations

import shutil
from pathlib import Path

from dynhair.comparison.methods import BASELINES, HAIR, method_config, row_name
from dynhair.comparison.record import Comparison, Row, require_same_settings
from dynhair.config import Config
from dynhair.errors import DynhairError
from dynhair.storage import atomic_file, atomic_folder
from dynhair.training.run import Run

SHARED = "shared"
LOG = "train.log"
DRIVEN = "driven_by"

_HAIR_FILES = ("canonical_hair.safetensors", "first_guess.safetensors", "hairstyle.png")
_MESH_FILES = ("mesh_head.safetensors", "mesh_head.png")


def shared_files(config: Config) -> tuple[str, ...]:
    """Files of a run that no ablation changes: the canonical hair and, where the head begins on it, the mesh head.

    Both depend on the capture, the seed and settings that all rows have in common. The row with one view has them, too:
    it sees one camera in the joint training.
    """
    return _HAIR_FILES + (_MESH_FILES if config.head.start == "mesh" else ())


def trained(comparison: Comparison, row: Row) -> bool:
    """Whether a row has been trained."""
    folder = comparison.path / row.folder
    if row.method == HAIR:
        return all(
            (folder / name).exists() for name in shared_files(comparison.config) if name.endswith(".safetensors")
        )
    return (folder / "avatar" / "avatar.json").exists()


def done(comparison: Comparison, row: Row) -> bool:
    """Whether a row has been trained and, if it is one of the table, evaluated."""
    evaluated = (comparison.path / row.folder / "evaluation" / "metrics.json").exists()
    return trained(comparison, row) and (row.method == HAIR or evaluated)


def driven(comparison: Comparison, row: Row) -> Path:
    """The folder with what was measured of a row as other people drive it; one folder inside for each of them."""
    return comparison.path / row.folder / DRIVEN


def finished(comparison: Comparison, row: Row) -> bool:
    """Whether nothing is left to do of a row: it is done, and all drivers have driven it."""
    drives = () if row.method == HAIR else comparison.drivers
    return done(comparison, row) and all((driven(comparison, row) / name / "metrics.json").exists() for name in drives)


def begin(comparison: Comparison, row: Row) -> None:
    """Make the folder of a row, if there is none yet, and give it what it shares.

    Raises:
        DynhairError: a run of other settings or of another capture is in the folder.
    """
    folder = comparison.path / row.folder
    config = method_config(comparison.config, row.method, row.seed)
    if not (folder / "run.json").exists():
        Run.create(folder, comparison.capture, config)
    run = Run.open(folder)
    require_same_settings(run.config, config, folder)
    if run.capture != comparison.capture:
        raise DynhairError(f"the run there is of {run.capture}", path=folder, expected=str(comparison.capture))
    if row.method != HAIR and row.method not in BASELINES:
        hair = comparison.path / SHARED / row_name(HAIR, row.seed)
        for name in shared_files(config):
            if (hair / name).exists() and not (folder / name).exists():
                with atomic_file(folder / name) as temporary:
                    shutil.copyfile(hair / name, temporary)


def take_avatar(run: Run, folder: Path) -> None:
    """Copy a trained run to the folder of a row: its settings, its hair and its avatar.

    Raises:
        DynhairError: a row that is not trained yet is in the folder.
    """
    if (folder / "avatar").exists():
        return
    if (folder / "run.json").exists():
        raise DynhairError(
            "the row has begun to be trained", path=folder, mend="leave out --avatar, or choose another folder"
        )
    with atomic_folder(folder) as temporary:
        _copy(run, temporary)
        shutil.copytree(run.avatar, temporary / "avatar")


def take_hair(run: Run, folder: Path) -> None:
    """Copy the canonical hair of a trained run, where it has kept it, to the folder of the hair that rows share."""
    if run.canonical_hair.exists() and not (folder / "run.json").exists():
        with atomic_folder(folder) as temporary:
            _copy(run, temporary)


def _copy(run: Run, folder: Path) -> None:
    for name in ("run.json", "config.yaml", *shared_files(run.config)):
        if (run.path / name).exists():
            shutil.copyfile(run.path / name, folder / name)
