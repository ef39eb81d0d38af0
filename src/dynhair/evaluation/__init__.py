"""Evaluation: metrics, the protocol that measures an avatar against a capture, reports and videos."""

from dynhair.evaluation.figures import DEFINITIONS, Figures
from dynhair.evaluation.hair_motion import HairMotion, motion_explained
from dynhair.evaluation.metrics import psnr, silhouette, silhouette_iou, ssim
from dynhair.evaluation.protocol import DrivenHead, EvaluatedFrame, Evaluation, SegmentFigures, evaluate_avatar
from dynhair.evaluation.report import evaluation_table
from dynhair.evaluation.run import render_motion, run_evaluation
from dynhair.evaluation.video import video_writer

__all__ = [
    "DEFINITIONS",
    "DrivenHead",
    "EvaluatedFrame",
    "Evaluation",
    "Figures",
    "HairMotion",
    "SegmentFigures",
    "evaluate_avatar",
    "evaluation_table",
    "motion_explained",
    "psnr",
    "render_motion",
    "run_evaluation",
    "silhouette",
    "silhouette_iou",
    "ssim",
    "video_writer",
]
