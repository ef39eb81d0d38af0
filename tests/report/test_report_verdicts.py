"""In words: where others are better, by how much, and whether that is more than chance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest
from made_comparisons import made_comparison, made_row

from dynhair.report.comparison import Comparison
from dynhair.report.scores import Scene
from dynhair.report.verdicts import Verdicts, judge


def verdicts(folder: Path, **figures: Mapping[str, Sequence[float | None]]) -> Verdicts:
    """Judge methods by the values of their seeds."""
    rows = []
    for method, values in figures.items():
        for seed in range(max(map(len, values.values()))):
            rows.append(made_row(folder, method, {key: seeds[seed] for key, seeds in values.items()}, seed=seed))
    return judge(Scene.of(Comparison.open(made_comparison(folder, rows)), "long"))


def test_others_that_are_better_come_with_their_margin(tmp_path: Path) -> None:
    found = verdicts(tmp_path, ours={"psnr": [21.0]}, gha={"psnr": [22.25]}, ga={"psnr": [21.5]})
    (finding,) = found.behind
    assert finding.figure == "PSNR of the whole image"
    assert finding.sentence == (
        "Ours 21.00 dB (higher is better). GHA 22.25 dB is better by 1.25 dB, of one seed, so that the spread is "
        "unknown; GA 21.50 dB is better by 0.50 dB, of one seed, so that the spread is unknown."
    )
    assert finding.beyond_spread is None
    assert not found.ahead


def test_ours_is_held_against_the_next_best(tmp_path: Path) -> None:
    found = verdicts(tmp_path, ours={"lpips": [0.2]}, gha={"lpips": [0.3]}, ga={"lpips": [0.25]})
    assert not found.behind
    (finding,) = found.ahead
    assert "Better than the next, GA 0.2500, by 0.0500" in finding.sentence


@pytest.mark.parametrize(("theirs", "beyond"), [([22.0, 23.0], True), ([21.0, 22.0], False)])
def test_a_difference_counts_if_it_exceeds_both_spreads(tmp_path: Path, theirs: list[float], beyond: bool) -> None:
    found = verdicts(tmp_path, ours={"psnr": [20.5, 21.5]}, gha={"psnr": theirs})
    # both spreads are 0.71
    (finding,) = found.behind
    assert finding.beyond_spread is beyond
    assert ("more than the spread over seeds" in finding.sentence) is beyond


def test_scaled_figures_are_held_against_scaled_spreads(tmp_path: Path) -> None:
    ours = {"hair_velocity": [0.050, 0.052], "hair_velocity_truth": [0.08, 0.08]}
    gha = {"hair_velocity": [0.060, 0.062], "hair_velocity_truth": [0.08, 0.08]}
    (finding,) = verdicts(tmp_path, ours=ours, gha=gha).behind
    assert finding.beyond_spread is True
    assert "nearer to the truth is better; the truth has 80.0" in finding.sentence
    assert "is better by 10.0 mm/s" in finding.sentence


def test_near_zero_and_near_the_truth_go_by_distance(tmp_path: Path) -> None:
    figures = {"hair_tlpips_excess": (-0.02, 0.01), "hair_tiou": (0.97, 0.88)}
    ours, gha = ({key: [pair[i]] for key, pair in figures.items()} | {"hair_tiou_truth": [0.9]} for i in (0, 1))
    found = verdicts(tmp_path, ours=ours, gha=gha)
    assert {finding.figure for finding in found.behind} == {
        "excess of temporal LPIPS",
        "tIoU of the hair from frame to frame",
    }
    assert "is better by 0.050" in next(f for f in found.behind if "tIoU" in f.figure).sentence


def test_what_shows_the_same_value_is_level(tmp_path: Path) -> None:
    found = verdicts(tmp_path, ours={"psnr": [21.001]}, gha={"psnr": [21.004]})
    assert (found.behind, found.ahead, found.level) == ((), (), ("PSNR of the whole image",))


def test_what_cannot_be_compared_is_said_with_reasons(tmp_path: Path) -> None:
    rows = [
        made_row(tmp_path, "ours", {"hair_iou": 0.9, "fid": None}, reasons={"fid": "no network"}),
        made_row(tmp_path, "gha", {"hair_iou": None, "fid": 30.0}, reasons={"hair_iou": "no coverage"}),
    ]
    missing = dict(judge(Scene.of(Comparison.open(made_comparison(tmp_path, rows)), "long")).missing)
    assert missing["IoU of the hair's silhouettes"] == "GHA: no coverage"
    assert missing["FID of the whole image"] == "Ours: no network"


def test_a_comparison_without_ours_judges_nothing(tmp_path: Path) -> None:
    found = verdicts(tmp_path, gha={"psnr": [20.0]}, ga={"psnr": [21.0]})
    assert (found.behind, found.ahead) == ((), ())
    assert {reason for _, reason in found.missing} == {"the comparison has no row of our method"}
