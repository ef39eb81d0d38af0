"""Registration of the open head: it finds heads again, whatever their pose and unit, and refuses what is no face."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from torch import Tensor

from dynhair.errors import DynhairError
from dynhair.face import open_head, register
from dynhair.face.registration import closest_similarity

TURN = torch.from_numpy(Rotation.from_rotvec([0.3, -0.9, 0.2]).as_matrix()).float()
SHIFT = torch.tensor([0.1, 0.7, -0.2])


def some_head(seed: int) -> Tensor:
    """Vertices of a head that is neither average nor extreme, with its mouth open."""
    head = open_head()
    identity = 0.7 * torch.randn(64, generator=torch.Generator().manual_seed(seed))
    expression = torch.zeros(52)
    expression[head.expression_names.index("jawOpen")] = 0.3
    return head.vertices(identity, expression)


def landmarks(vertices: Tensor) -> Tensor:
    return vertices[open_head().landmarks66]


def face_error(found: Tensor, truth: Tensor) -> float:
    """Mean distance of corresponding vertices of face and neck-free head, ears and scalp apart."""
    head = open_head()
    front = (head.head_weight > 0.95) & (head.mean[:, 2] > 0.05)
    return float((found - truth)[front].norm(dim=1).mean())


@given(
    st.lists(st.floats(-3, 3), min_size=3, max_size=3),
    st.floats(1e-3, 1e3),
    st.lists(st.floats(-10, 10), min_size=3, max_size=3),
)
def test_the_closed_form_recovers_a_similarity(vector: list[float], scale: float, shift: list[float]) -> None:
    points = np.random.default_rng(0).normal(size=(20, 3))
    rotation = Rotation.from_rotvec(vector).as_matrix()
    found_scale, found_rotation, found_shift = closest_similarity(points, scale * points @ rotation.T + shift)
    assert found_scale == pytest.approx(scale, rel=1e-9)
    np.testing.assert_allclose(found_rotation, rotation, atol=1e-9)
    np.testing.assert_allclose(found_shift, shift, atol=1e-9 * max(scale, 10))


def test_the_closed_form_is_the_best_rotation_even_for_a_mirror_image() -> None:
    generator = np.random.default_rng(0)
    points = generator.normal(size=(20, 3))
    target = points * [-1, 1, 1] + 0.1 * generator.normal(size=(20, 3))
    scale, rotation, shift = closest_similarity(points, target)
    assert np.linalg.det(rotation) == pytest.approx(1)
    best = np.square(scale * points @ rotation.T + shift - target).sum()
    for axis in np.eye(3):
        near = rotation @ Rotation.from_rotvec(0.02 * axis).as_matrix()
        assert np.square(scale * points @ near.T + shift - target).sum() > best


def test_the_average_head_is_found_exactly() -> None:
    head = open_head()
    truth = head.mean @ TURN.T + SHIFT
    found = register(landmarks(truth))
    assert found.scale == pytest.approx(1, abs=1e-4)
    torch.testing.assert_close(found.rotation, TURN, atol=1e-4, rtol=0)
    torch.testing.assert_close(found.vertices(), truth, atol=1e-4, rtol=0)
    assert found.identity.norm() < 0.01
    assert found.landmark_distance < 1e-5


@pytest.mark.parametrize("seed", range(3))
def test_a_head_is_found_from_its_own_landmarks(seed: int) -> None:
    truth = some_head(seed) @ TURN.T + SHIFT
    found = register(landmarks(truth))
    assert found.scale == pytest.approx(1, abs=0.08)
    assert found.landmark_distance < 1e-3
    average = register(landmarks(open_head().mean @ TURN.T + SHIFT)).vertices()
    assert face_error(found.vertices(), truth) < 3e-3
    assert face_error(found.vertices(), truth) < 0.6 * face_error(average, truth)


@settings(max_examples=5)
@given(st.floats(-3, 3))
def test_unit_and_pose_of_the_landmarks_do_not_matter(exponent: float) -> None:
    truth = some_head(0)
    plain = register(landmarks(truth))
    unit = 10.0**exponent
    other = register(landmarks(unit * (truth @ TURN.T + SHIFT)))
    assert other.scale == pytest.approx(unit * plain.scale, rel=1e-3)
    torch.testing.assert_close(other.identity, plain.identity, atol=0.01, rtol=0)
    torch.testing.assert_close(other.vertices() / unit, plain.vertices() @ TURN.T + SHIFT, atol=2e-4, rtol=0)


def test_noise_of_some_millimetres_and_false_landmarks_do_little() -> None:
    truth = some_head(1)
    generator = torch.Generator().manual_seed(0)
    observed = landmarks(truth) + 0.002 * torch.randn(66, 3, generator=generator)
    clean, noisy = register(landmarks(truth)), register(observed)
    assert face_error(noisy.vertices(), truth) < face_error(clean.vertices(), truth) + 3e-3
    assert noisy.scale == pytest.approx(1, abs=0.1)
    observed[[20, 40, 55]] += torch.tensor([0.0, 0.03, 0.05])
    assert face_error(register(observed).vertices(), noisy.vertices()) < 2e-3


def test_landmarks_that_slide_along_the_outline_of_the_face_do_little() -> None:
    head = open_head()
    observed = landmarks(head.mean)
    outline = [*range(8), *range(9, 17)]
    skin = head.mean[(head.head_weight > 0.95) & (head.mean[:, 0].abs() > 0.03)]
    ahead = observed[outline] + torch.tensor([0.0, 0.01, 0.03])
    observed[outline] = skin[torch.cdist(ahead, skin).argmin(1)]
    assert (observed - landmarks(head.mean)).norm(dim=1).max() > 0.025
    assert face_error(register(observed).vertices(), head.mean) < 2e-3


def test_motion_within_the_face_is_expression() -> None:
    head = open_head()
    strength = torch.zeros(52)
    strength[head.expression_names.index("jawOpen")] = 0.5
    strength[head.expression_names.index("browInnerUp")] = 0.5
    rest, moved = head.vertices() @ TURN.T * 3, head.vertices(expression=strength) @ TURN.T * 3
    found = register(landmarks(rest))
    change = found.expression_change(landmarks(moved) - landmarks(rest))
    error, motion = landmarks(found.vertices(change) - moved).norm(dim=1), landmarks(moved - rest).norm(dim=1)
    assert error.mean() < 0.15 * motion.mean()
    assert not found.expression_change(torch.zeros(66, 3)).any()


def test_landmarks_that_are_no_face_are_refused() -> None:
    face = landmarks(open_head().mean)
    nowhere = face.clone()
    nowhere[3] = torch.nan
    shuffled = face[torch.randperm(66, generator=torch.Generator().manual_seed(0))]
    for broken in (nowhere, face * torch.tensor([-1.0, 1, 1]), shuffled, torch.zeros(66, 3)):
        with pytest.raises(DynhairError, match="landmarks"):
            register(broken)
