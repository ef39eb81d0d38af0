"""What a user decides about preprocessing; light to import, as the command line reads it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from dynhair.errors import DynhairError

LayoutName = Literal["nersemble2", "nersemble1", "hhavatar", "vhap", "capture", "videos", "images"]
Crop = tuple[int, int, int, int] | Literal["square"] | None
Size = tuple[int, int] | int | None
Up = Literal["x", "-x", "y", "-y", "z", "-z"]
MattingMethod = Literal["auto", "given", "plate", "fast", "quality", "modnet"]
HairMethod = Literal["auto", "given", "taught", "network"]


@dataclass(frozen=True)
class ImportOptions:
    """What to take from a recording, and in which size.

    Attributes:
        layout: How the recording is laid out; `auto` tells by its files.
        calibration: The cameras, where they are not at their layout's usual place: our JSON, a folder of COLMAP's, or
            OpenCV's YAML or XML.
        fps: Frames per second, in the place of what the recording says.
        takes: Names of the takes to use; all by default.
        cameras: Names of the cameras to use; all by default.
        start: First frame of every take, counted from 0.
        stop: Frame of every take before which to stop; its end by default.
        stride: Use every n-th frame; the frame rate is divided by it.
        crop: x, y, width and height in pixels of the undistorted picture, or "square" for the largest in the middle.
        size: Length of the longer side in pixels, or width and height; as filmed by default.
        test_takes: Names of the takes that are held out. By default what the recording says, else the take called
            FREE, else the last; a single take trains.
        metres_per_unit: Length of the recording's unit; as its calibration says by default, or 1.
        up: The axis of the recording's world that points up; as its calibration says by default, or y.
    """

    layout: LayoutName | Literal["auto"] = "auto"
    calibration: Path | None = None
    fps: float | None = None
    takes: tuple[str, ...] | None = None
    cameras: tuple[str, ...] | None = None
    start: int = 0
    stop: int | None = None
    stride: int = 1
    crop: Crop = None
    size: Size = None
    test_takes: tuple[str, ...] | None = None
    metres_per_unit: float | None = None
    up: Up | None = None

    def __post_init__(self) -> None:
        if self.takes == () or self.cameras == ():
            raise DynhairError("no take or no camera is to be used", expected="one name or more, or None for all")
        if self.start < 0 or (self.stop is not None and self.stop <= self.start):
            raise DynhairError(f"the frames from {self.start} to {self.stop}", expected="0 <= start < stop")
        if self.stride < 1:
            raise DynhairError(f"a stride of {self.stride}", expected="1 or more")
        if self.metres_per_unit is not None and not 0 < self.metres_per_unit < float("inf"):
            raise DynhairError(f"{self.metres_per_unit} metres per unit", expected="a number above 0")
        sides = () if self.size is None else (self.size,) if isinstance(self.size, int) else self.size
        if any(side < 1 for side in sides):
            raise DynhairError(f"a size of {self.size}", expected="pixels, 1 or more")


@dataclass(frozen=True)
class PreprocessOptions:
    """How a recording becomes a capture.

    Attributes:
        matting: Where the person's mask comes from. `given`: masks that came with the recording. `plate`: difference to
            the empty scene, a picture for each camera or one colour. `fast`: a small network, 10 ms a view. `quality`:
            a large one, seconds a view, soft at the hair's edge. `modnet`: your own MODNet, as ONNX. `auto`: the first
            of given, plate and fast that can be had.
        backdrop: Colour of a plain background, red green blue from 0 to 255, for `plate`.
        modnet: ONNX file of MODNet.
        hair: Where the hair's mask comes from. `taught`: a small classifier, which the network's surest labels teach
            what this person's hair looks like, on all views. `network`: the network alone, on each view that shows the
            face. `given`: masks that came with the recording, or those in `hair-masks`. `auto`: given, else taught.
        hair_masks: Folder of your own hair masks, or of CDGNet's label maps: FRAME/CAMERA.png, as 0000/00.png.
        hair_label: The label that hair has in these maps, 2 in CDGNet's; leave it out for masks.
        hair_examples: Folder of a few hair masks painted by you, FRAME_CAMERA.png, that teach the classifier too.
        steady: Remove flicker from masks over time; nothing that moves is delayed.
        face_model: Morphable model of the tracked head: `open`, or from your own files `ict:FOLDER`, `bfm:FILE` or
            `flame:FILE`.
        silhouette: Let body masks refine the tracked head.
    """

    matting: MattingMethod = "auto"
    backdrop: tuple[int, int, int] | None = None
    modnet: Path | None = None
    hair: HairMethod = "auto"
    hair_masks: Path | None = None
    hair_label: int | None = None
    hair_examples: Path | None = None
    steady: bool = False
    face_model: str = "open"
    silhouette: bool = False

    def check(self) -> None:
        """See whether the files are there, before hours are spent on the steps before they are needed.

        Raises:
            DynhairError: one is missing.
        """
        for path in (self.modnet, self.hair_masks, self.hair_examples):
            if path is not None and not path.exists():
                raise DynhairError("is not there", path=path)
        if self.matting == "modnet" and self.modnet is None:
            raise DynhairError("matting by MODNet needs your file of it", mend="give the ONNX file by --modnet")
        if self.backdrop is not None and not all(0 <= value <= 255 for value in self.backdrop):
            raise DynhairError(f"a backdrop of {self.backdrop}", expected="red, green and blue from 0 to 255")
