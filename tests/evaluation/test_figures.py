"""Running means against plain means."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
import torch

from dynhair.evaluation.definitions import DEFINITIONS, HAIR_FIGURES, MOTION
from dynhair.evaluation.figures import Figures, FigureSums


def test_running_means_equal_plain_means() -> None:
    values = np.random.default_rng(0).random((50, 4))
    sums = FigureSums()
    for frame in values:
        sums.add_frame(images=4)
        sums.add("psnr", torch.from_numpy(frame))
    figures = sums.figures()
    assert figures.values["psnr"] == pytest.approx(values.mean(), rel=1e-14)
    assert (figures.frames, figures.images, figures.samples["psnr"]) == (50, 200, 200)


def test_views_without_the_figure_do_not_count() -> None:
    sums = FigureSums()
    sums.add("hair_iou", torch.tensor([0.5, math.nan]))
    sums.add("hair_iou", torch.tensor([math.nan, 0.25]))
    figures = sums.figures()
    assert figures.values["hair_iou"] == 0.375
    assert figures.samples["hair_iou"] == 2


def test_motion_divides_mean_errors_not_ratios() -> None:
    sums = FigureSums()
    sums.add_motion(0.01, 0.04)
    sums.add_motion(0.01, 0.01)
    assert sums.figures().values[MOTION] == pytest.approx(1.0 - 0.02 / 0.05)


def test_merging_equals_adding_everything_to_one() -> None:
    whole, first, second = FigureSums(), FigureSums(), FigureSums()
    for part, (values, errors) in zip((first, second), (([1.0, 2.0], (0.1, 0.3)), ([6.0], (0.2, 0.2))), strict=True):
        for sums in (part, whole):
            sums.add_frame(images=len(values))
            sums.add("ssim", torch.tensor(values))
            sums.add_motion(*errors)
    first.merge(second)
    assert first.figures() == whole.figures()
    assert first.figures().values["ssim"] == 3.0


def test_what_is_missing_says_why() -> None:
    sums = FigureSums()
    sums.explain("no masks", *HAIR_FIGURES)
    sums.add("psnr", torch.tensor([30.0]))
    sums.add("ssim", torch.tensor([math.nan]))
    sums.add_motion(0.0, 0.0)
    figures = sums.figures()
    assert {name for name, value in figures.values.items() if value is None} == set(figures.reasons)
    assert "psnr" not in figures.reasons
    assert figures.reasons["hair_iou"] == "no masks"
    assert "stands still" in figures.reasons[MOTION]


def test_a_reason_yields_to_a_measurement() -> None:
    sums = FigureSums()
    sums.explain("no masks", "hair_iou")
    sums.add("hair_iou", torch.tensor([0.5]))
    assert "hair_iou" not in sums.figures().reasons


def test_unmeasured_figures_are_null_in_json() -> None:
    written = json.loads(json.dumps(Figures.unmeasured("nothing to see").to_json(), allow_nan=False))
    assert all(written[name] is None and written["reasons"][name] == "nothing to see" for name in DEFINITIONS)
    assert written["images"] == 0
