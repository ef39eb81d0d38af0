from __future__ import annotations

import numpy as np

from dynhair.preprocess.steps.tracking import from_neutral
from dynhair.preprocess.tracking import Observations


def take(hints: np.ndarray | None) -> Observations:
    frames = 5 if hints is None else len(hints)
    return Observations(
        points=np.zeros((frames, 1, 2, 2)),
        scores=np.zeros((frames, 1, 2)),
        w2c=np.zeros((frames, 1, 3, 4)),
        K=np.zeros((frames, 1, 3, 3)),
        expression_hints=hints,
        fps=30.0,
    )


def test_what_the_network_always_says_is_the_shape_of_the_face() -> None:
    brows = np.full(8, 0.8)
    jaw = np.array([0.0, 0.0, 0.1, 0.0, 0.9, 0.8, 0.0, 0.0])
    smile = np.array([0.2, 0.2, 0.2, 0.7, 0.2, 0.0, 0.2, 0.2])
    hints = np.stack([brows, jaw, smile], -1)
    first, second = from_neutral([take(hints[:3]), take(hints[3:])])
    assert first.expression_hints is not None
    assert second.expression_hints is not None
    found = np.concatenate([first.expression_hints, second.expression_hints])
    np.testing.assert_allclose(found[:, 0], 0)
    np.testing.assert_allclose(found[:, 1], jaw)
    np.testing.assert_allclose(found[:, 2], [0, 0, 0, 0.5, 0, 0, 0, 0])


def test_takes_without_hints_stay_without() -> None:
    (found,) = from_neutral([take(None)])
    assert found.expression_hints is None
