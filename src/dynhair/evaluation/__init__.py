"""Evaluation: metrics, the protocol that measures an avatar against a capture, reports and videos."""

from dynhair.evaluation.appearance import Appearance
from dynhair.evaluation.definitions import DEFINITIONS
from dynhair.evaluation.figures import Figures
from dynhair.evaluation.hair_motion import HairMotion, motion_explained
from dynhair.evaluation.hairstyle import HairstyleEvaluation, HairstyleScores, evaluate_hairstyles, hairstyle_scores
from dynhair.evaluation.metrics import psnr, silhouette, silhouette_iou, ssim
from dynhair.evaluation.perception import Perception
from dynhair.evaluation.protocol import DrivenHead, evaluate_avatar
from dynhair.evaluation.records import EvaluatedFrame, Evaluation, SegmentFigures
from dynhair.evaluation.report import evaluation_table, hairstyle_table
from dynhair.evaluation.run import RunEvaluation, run_evaluation
from dynhair.evaluation.strand_scores import StrandScore, strand_scores

__all__ = [
    "DEFINITIONS",
    "Appearance",
    "DrivenHead",
    "EvaluatedFrame",
    "Evaluation",
    "Figures",
    "HairMotion",
    "HairstyleEvaluation",
    "HairstyleScores",
    "Perception",
    "RunEvaluation",
    "SegmentFigures",
    "StrandScore",
    "evaluate_avatar",
    "evaluate_hairstyles",
    "evaluation_table",
    "hairstyle_scores",
    "hairstyle_table",
    "motion_explained",
    "psnr",
    "run_evaluation",
    "silhouette",
    "silhouette_iou",
    "ssim",
    "strand_scores",
]
