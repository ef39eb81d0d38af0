"""Raw recordings of many layouts, brought into a workspace: one size, no distortion, metres, y up."""

from dynhair.preprocess.sources.calibration import Calibration, read_calibration
from dynhair.preprocess.sources.importing import import_recording
from dynhair.preprocess.sources.layouts import open_recording
from dynhair.preprocess.sources.plan import ImportPlan, plan_import
from dynhair.preprocess.sources.recording import Recording, World

__all__ = [
    "Calibration",
    "ImportPlan",
    "Recording",
    "World",
    "import_recording",
    "open_recording",
    "plan_import",
    "read_calibration",
]
