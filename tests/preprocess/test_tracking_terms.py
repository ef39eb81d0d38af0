"""Costs of tracking against their derivatives by automatic and finite differences."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy import ndarray
from scipy.spatial.transform import Rotation
from tracked_heads import REST, cameras_around, landmark_anchors, scene, smooth_motion

from dynhair.camera import Camera
from dynhair.face import open_head
from dynhair.preprocess.tracking.anchored_head import AnchoredHead, Person
from dynhair.preprocess.tracking.expression_prior import ExpressionPrior
from dynhair.preprocess.tracking.frame_equations import frame_equations
from dynhair.preprocess.tracking.head_motion import POSE, HeadMotion
from dynhair.preprocess.tracking.person_fit import PersonProblem, offset_precision
from dynhair.preprocess.tracking.reprojection import Reprojection, project
from dynhair.preprocess.tracking.silhouette import Silhouettes, skin_vertices

MODEL = open_head()
ANCHORS = landmark_anchors(MODEL)
HEAD = AnchoredHead.of(MODEL, ANCHORS)


def slope(cost: Callable[[float], float], step: float = 1e-6) -> float:
    return (cost(step) - cost(-step)) / (2 * step)


def reprojection(frames: int, noise: float, rng: np.random.Generator) -> tuple[Reprojection, HeadMotion, Person]:
    shown = scene(frames, (-30.0, 20.0), noise=noise)
    observed = shown.observed
    scores = rng.uniform(size=observed.scores.shape) * (rng.random(observed.scores.shape) > 0.1)
    deviations = rng.uniform(1, 3, size=scores.shape)
    points = np.where(scores[..., None] > 0, observed.points, np.nan)
    return Reprojection(points, scores, deviations, observed.w2c, observed.K), shown.motion, shown.person


def test_anchored_points_are_those_of_the_model() -> None:
    rng = np.random.default_rng(0)
    identity, expression = rng.normal(size=len(MODEL.identity_modes)), rng.uniform(size=len(MODEL.expression_modes))
    vertices = MODEL.vertices(torch.from_numpy(identity).float(), torch.from_numpy(expression).float()).numpy()
    offsets = 1e-3 * rng.normal(size=HEAD.mean.shape)
    points = HEAD.points(Person(1.2, identity, offsets), expression[None])[0]
    np.testing.assert_allclose(points, 1.2 * (vertices[MODEL.landmarks68.numpy()] + offsets), atol=1e-6)
    chosen = np.array([5, 700, 3000])
    some = AnchoredHead.of_vertices(MODEL, chosen).points(Person(1.0, identity, np.zeros((3, 3))), expression[None])
    np.testing.assert_allclose(some[0], vertices[chosen], atol=1e-6)


def test_projection_against_the_camera_and_automatic_derivatives() -> None:
    w2c, K = cameras_around(1, (-40.0, 25.0))
    points = np.random.default_rng(0).normal(size=(1, 7, 3)) * 0.1 + [0.1, 1.5, -0.2]
    pixels, slopes = project(points, w2c, K)
    for view in range(2):
        camera = Camera(torch.from_numpy(w2c[0, view]), torch.from_numpy(K[0, view]), 640, 480)
        for n in range(7):
            point = torch.from_numpy(points[0, n])
            np.testing.assert_allclose(pixels[0, view, n], camera.project(point)[0].numpy(), rtol=1e-12)
            expected = torch.autograd.functional.jacobian(lambda p, c=camera: c.project(p)[0], point)
            assert isinstance(expected, torch.Tensor)
            np.testing.assert_allclose(slopes[0, view, n], expected.numpy(), rtol=1e-9, atol=1e-9)


def test_gradient_of_reprojection() -> None:
    rng = np.random.default_rng(0)
    data, motion, person = reprojection(3, 4.0, rng)
    points = motion.to_world(HEAD.points(person, motion.expressions))
    gradient, curvature = data.linearised(points)
    step = rng.normal(size=points.shape)
    assert (gradient * step).sum() == pytest.approx(slope(lambda h: data.cost(points + h * step)), rel=1e-4)
    np.testing.assert_allclose(curvature, curvature.swapaxes(-1, -2), atol=1e-6)
    assert np.linalg.eigvalsh(curvature).min() > -1e-6


def test_curvature_of_reprojection_without_errors() -> None:
    """Where landmarks are met exactly the curvature is exact too."""
    rng = np.random.default_rng(0)
    data, motion, person = reprojection(2, 0.0, rng)
    points = motion.to_world(HEAD.points(person, motion.expressions))
    _, curvature = data.linearised(points)
    step = rng.normal(size=points.shape)
    assert 2 * data.cost(points + 1e-7 * step) / 1e-14 == pytest.approx(
        np.einsum("fni,fnij,fnj->", step, curvature, step), rel=1e-3
    )


def test_missing_landmarks_have_no_residual_and_far_ones_no_belief() -> None:
    data, motion, person = reprojection(2, 0.0, np.random.default_rng(0))
    points = motion.to_world(HEAD.points(person, motion.expressions))
    data = replace(data, landmarks=data.landmarks.copy())
    seen = np.argwhere(data.scores > 0)[0]
    data.landmarks[tuple(seen)] += 1000
    belief = data.belief(points)
    assert (data.residuals(points)[data.scores == 0] == 0).all()
    assert belief[tuple(seen)] < 1e-4
    others = data.scores.copy()
    others[tuple(seen)] = 0
    np.testing.assert_allclose(belief * (others > 0), others, atol=1e-9)


def test_noise_factors_find_noisy_landmarks() -> None:
    shown = scene(60)
    rng = np.random.default_rng(0)
    factors = np.where(np.arange(68) % 2, 3.0, 1.0)
    noise = rng.standard_t(3, size=shown.observed.points.shape) * factors[:, None]
    o = shown.observed
    data = Reprojection(o.points + noise, o.scores, np.ones(o.scores.shape), o.w2c, o.K)
    points = shown.motion.to_world(HEAD.points(shown.person, shown.motion.expressions))
    found = np.ones(68)
    for _ in range(10):
        found = found * data.blurred(found).noise_factors(points)
    assert np.median(found[1::2]) / np.median(found[::2]) == pytest.approx(3, rel=0.15)


def test_gradient_of_frame_equations() -> None:
    rng = np.random.default_rng(0)
    data, motion, person = reprojection(3, 4.0, rng)
    motion = replace(motion, expressions=motion.expressions + 0.1)

    def cost(at: HeadMotion) -> float:
        return data.cost(at.to_world(HEAD.points(person, at.expressions)))

    term = data.linearised(motion.to_world(HEAD.points(person, motion.expressions)))
    equations = frame_equations(HEAD, person, motion, term)
    for _ in range(3):
        step = rng.normal(size=equations.gradient.shape) * np.repeat([1.0, 0.1, 1.0], [3, 3, step_size() - POSE])
        found = (equations.gradient * step).sum()
        assert found == pytest.approx(slope(lambda h, s=step: cost(motion.moved(h * s))), rel=1e-5)


def step_size() -> int:
    return POSE + HEAD.expression_modes.shape[-1]


def test_expression_prior_against_automatic_derivatives() -> None:
    rng = np.random.default_rng(0)
    prior = ExpressionPrior(rng.uniform(size=(3, 4)), 0.2, (0.0, 1.0))
    at = rng.uniform(-0.5, 1.5, size=(3, 4))
    gradient, curvature = prior.linearised(at)
    for index in np.ndindex(at.shape):
        bump = np.zeros_like(at)
        bump[index] = 1.0
        assert gradient[index] == pytest.approx(slope(lambda h, b=bump: prior.cost(at + h * b)), rel=1e-6)
        bend = (prior.cost(at + 1e-4 * bump) - 2 * prior.cost(at) + prior.cost(at - 1e-4 * bump)) / 1e-8
        assert curvature[index] == pytest.approx(bend, rel=1e-4)


def test_the_person_found_is_the_most_likely_one() -> None:
    rng = np.random.default_rng(0)
    data, motion, _ = reprojection(5, 2.0, rng)
    prior = ExpressionPrior(np.zeros((5, 52)), 0.3, (0.0, 1.0))
    problem = PersonProblem(HEAD, data, 0.5, prior, offset_precision(HEAD.mean, np.full(68, 3e-3)))
    person, motion = problem.solve(HEAD.average_person(), motion)
    best = problem.cost((person, motion))
    for _ in range(10):
        identity, offsets = rng.normal(size=person.identity.shape), 1e-2 * rng.normal(size=person.offsets.shape)
        steps = rng.normal(size=(5, step_size()))
        for h in (-1e-4, 1e-4):
            other = Person(person.scale, person.identity + h * identity, person.offsets + h * offsets)
            assert problem.cost((other, motion.moved(h * steps))) > best


def bulge(frame: int, view: int) -> ndarray:
    """A body in the lower left of the picture."""
    y, x = np.mgrid[:480, :640]
    return np.where(x + 0.7 * y < 500 + 20 * frame - 30 * view, 255, 0).astype(np.uint8)


def test_gradient_of_silhouettes() -> None:
    rng = np.random.default_rng(0)
    w2c, K = cameras_around(2, (-20.0, 20.0))
    silhouettes = Silhouettes.of_masks(bulge, np.full((2, 2), 2.0), w2c, K)
    points = REST + 0.08 * rng.normal(size=(2, 40, 3))
    gradient, curvature = silhouettes.linearised(points)
    step = rng.normal(size=points.shape)
    assert np.abs(gradient).max() > 0
    found = slope(lambda h: silhouettes.cost(points + h * step), 1e-7)
    assert (gradient * step).sum() == pytest.approx(found, rel=1e-3)
    assert np.linalg.eigvalsh(curvature).min() > -1e-6


def test_silhouettes_cost_pixels_outside_and_nothing_inside() -> None:
    w2c, K = cameras_around(1, (0.0,))
    empty = Silhouettes.of_masks(lambda *_: np.zeros((480, 640), np.uint8), np.ones((1, 1)), w2c, K)
    half = Silhouettes.of_masks(
        lambda *_: np.where(np.arange(640) < 320, 255, 0).astype(np.uint8) * np.ones((480, 1), np.uint8),
        np.ones((1, 1)),
        w2c,
        K,
    )
    aside = np.array([0.02, 0, 0])
    inside, outside = REST - aside, REST + aside
    assert empty.cost(outside[None, None]) == 0
    assert half.cost(inside[None, None]) == 0
    distance = 900 * 0.02 / 1.3
    assert half.cost(outside[None, None]) == pytest.approx(2 * np.log1p(distance**2 / 3), rel=0.1)


def test_skin_is_bare_and_moves_with_the_head() -> None:
    skin = skin_vertices(MODEL)
    assert 100 < len(skin) <= 300
    assert not np.isin(skin, MODEL.faces[MODEL.scalp].numpy()).any()
    assert (MODEL.head_weight.numpy()[skin] > 0.9).all()


def test_turning_the_world_turns_the_motion() -> None:
    motion = smooth_motion(4, 24)
    vector = np.array([0.1, -0.2, 0.3])
    steps = np.tile(np.concatenate([vector, [1.0, 2, 3], np.zeros(24)]), (4, 1))
    moved = motion.moved(steps)
    turn = Rotation.from_rotvec(vector).as_matrix()
    np.testing.assert_allclose(moved.rotations, turn @ motion.rotations, atol=1e-12)
    np.testing.assert_allclose(moved.translations - motion.translations, [[1, 2, 3]] * 4)
