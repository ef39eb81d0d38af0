"""Choosing a face model by a word."""

from __future__ import annotations

from pathlib import Path

from dynhair.errors import DynhairError
from dynhair.face.bfm import bfm
from dynhair.face.flame import flame
from dynhair.face.ict_facekit import ict_facekit
from dynhair.face.model import FaceModel
from dynhair.face.open_head import open_head

_READERS = {"ict": ict_facekit, "bfm": bfm, "flame": flame}


def face_model(spec: str = "open") -> FaceModel:
    """The face model that a word names.

    Args:
        spec: "open", the model that comes with the package, or one from the user's files: "ict:FOLDER", "bfm:FILE",
            "flame:FILE".

    Raises:
        DynhairError: there is no such kind of model, or its files are missing or of another kind.
    """
    kind, _, path = spec.partition(":")
    if spec == "open":
        return open_head()
    if kind not in _READERS or not path:
        raise DynhairError(f"there is no face model {spec!r}", expected="open, ict:FOLDER, bfm:FILE or flame:FILE")
    return _READERS[kind](Path(path).expanduser())
