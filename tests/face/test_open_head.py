"""The open head: sound arrays, the conventions of axes, and landmarks where a face has them."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from dynhair.face import FaceModel, open_head
from dynhair.strands import MeshDistance

# iBUG-68's pairs of the person's right and left
MIRRORED = np.arange(68)
MIRRORED[:17] = np.arange(16, -1, -1)
MIRRORED[17:27] = np.arange(26, 16, -1)
MIRRORED[31:36] = np.arange(35, 30, -1)
MIRRORED[36:48] = [45, 44, 43, 42, 47, 46, 39, 38, 37, 36, 41, 40]
MIRRORED[48:60] = [54, 53, 52, 51, 50, 49, 48, 59, 58, 57, 56, 55]
MIRRORED[60:68] = [64, 63, 62, 61, 60, 67, 66, 65]


@pytest.fixture(scope="module")
def head() -> FaceModel:
    return open_head()


@pytest.fixture(scope="module")
def marks(head: FaceModel) -> Tensor:
    return head.mean[head.landmarks68]


def test_arrays_fit_together(head: FaceModel) -> None:
    count = len(head.mean)
    assert head.identity_modes.shape[1:] == head.expression_modes.shape[1:] == (count, 3)
    assert head.identity_modes.dtype == head.mean.dtype == torch.float32
    assert len(head.expression_names) == len(head.expression_modes) == 52
    assert head.faces.min() == 0
    assert head.faces.max() == count - 1
    assert 0 <= head.scalp.min() <= head.scalp.max() < len(head.faces)
    assert len(head.scalp.unique()) == len(head.scalp)
    assert 0 <= head.head_weight.min() <= head.head_weight.max() <= 1
    assert open_head() is head


def test_vertices_are_linear_in_the_coefficients(head: FaceModel) -> None:
    generator = torch.Generator().manual_seed(0)
    identity, expression = torch.randn(64, generator=generator), torch.rand(52, generator=generator)
    expected = (
        head.mean.double().numpy()
        + np.einsum("k,kvi->vi", identity.double().numpy(), head.identity_modes.double().numpy())
        + np.einsum("e,evi->vi", expression.double().numpy(), head.expression_modes.double().numpy())
    )
    np.testing.assert_allclose(head.vertices(identity, expression).numpy(), expected, atol=1e-5)
    assert torch.equal(head.vertices(), head.mean)


def test_the_head_is_upright_faces_forward_and_has_a_natural_size(head: FaceModel, marks: Tensor) -> None:
    part = head.mean[head.head_weight > 0.95]
    assert 0.19 < float(part[:, 1].max() - marks[8, 1]) < 0.27  # crown to chin
    assert marks[30, 2] > head.mean[:, 2].max() - 1e-3  # the tip of the nose is foremost
    assert marks[36:48, 1].min() > marks[30, 1] > marks[48:, 1].max() > marks[8, 1]
    assert 0.055 < float((marks[42:48].mean(0) - marks[36:42].mean(0))[0]) < 0.07  # the person's left is at +x
    shoulders = head.mean[head.head_weight < 0.05]
    assert shoulders[:, 1].mean() < marks[8, 1]


def test_everything_within_the_head_moves_with_it(head: FaceModel) -> None:
    face = (head.mean[:, 1] > 0) & (head.mean[:, 2] > 0.03)
    assert (head.head_weight[face] > 0.97).all()  # eyeballs too
    skull = head.head_weight == 1
    assert 0.6 < float(skull.float().mean()) < 0.8


def test_faces_point_outwards(head: FaceModel) -> None:
    mesh = MeshDistance(head.mean, head.faces)
    distances, _ = mesh.query(torch.tensor([[0.0, 0.06, 0.02], [0.0, -0.2, 0.0], [0.0, 0.06, 0.3], [0.0, 0.3, 0.0]]))
    assert (distances[:2] < -0.02).all()
    assert (distances[2:] > 0.05).all()


def test_the_scalp_is_the_hairy_part_of_the_head(head: FaceModel, marks: Tensor) -> None:
    centres = head.mean[head.faces[head.scalp]].mean(1)
    assert centres[:, 1].max() > head.mean[:, 1].max() - 0.01
    forehead = centres[centres[:, 2] > 0.06]
    assert forehead[:, 1].min() > marks[17:27, 1].max() + 0.01  # hair begins above the brows
    weight = head.head_weight[head.faces[head.scalp]]
    assert weight.mean() > 0.95
    assert weight.min() > 0.5  # at the nape
    triangles = head.mean[head.faces[head.scalp]]
    area = (
        torch.linalg.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]).norm(dim=1).sum() / 2
    )
    assert 0.04 < float(area) < 0.09


def test_landmarks_mirror_one_another(head: FaceModel, marks: Tensor) -> None:
    assert len(set(head.landmarks68.tolist())) == 68
    mirrored = marks[torch.from_numpy(MIRRORED)] * torch.tensor([-1.0, 1.0, 1.0])
    assert (marks - mirrored).norm(dim=1).max() < 1e-3
    middle = marks[[8, 27, 28, 29, 30, 33, 51, 57, 62, 66]]
    assert middle[:, 0].abs().max() < 1e-3


def test_landmarks_are_in_ibugs_order(marks: Tensor) -> None:
    x, y, z = marks.unbind(1)
    brows, upper_lip = x[17:27], x[48:55]
    for row in (brows, upper_lip, x[31:36], x[60:65], z[27:31], -y[:9], -y[27:31]):
        assert (row.diff() > 0).all()
    assert (x[:17].diff() > -1e-3).all()  # the jaw runs from the person's right to the left
    for eye in (36, 42):
        outer, upper_a, upper_b, inner, lower_a, lower_b = range(eye, eye + 6)
        assert x[outer] < x[upper_a] < x[upper_b] < x[inner]
        assert x[lower_b] < x[lower_a]
        assert min(y[upper_a], y[upper_b]) > max(y[outer], y[inner]) > max(y[lower_a], y[lower_b])
        assert 0.022 < float(x[inner] - x[outer]) < 0.035
    assert (y[17:22] > y[37] + 0.01).all()
    assert x[17] < x[36] < x[39] < x[31] < x[32] < x[33]
    assert y[51] > y[62] > y[66] > y[57]
    assert (y[62] - y[66]).abs() < 0.002  # the mouth is closed
    assert x[48] < x[60] < x[61]


def test_expressions_move_the_landmarks_of_their_place(head: FaceModel) -> None:
    def moved(name: str) -> Tensor:
        return head.expression_modes[head.expression_names.index(name)][head.landmarks68]

    jaw, blink, smile = moved("jawOpen"), moved("eyeBlinkLeft"), moved("mouthSmileRight")
    assert jaw[[8, 57, 66], 1].max() < -0.015
    assert jaw[[27, 30, 37, 62], 1].abs().max() < 0.002
    assert blink[[43, 44], 1].max() < -0.005  # 42 to 47 are the person's left eye
    assert blink[[37, 38]].abs().max() < 1e-3
    assert smile[48, 1] > 0.003  # 48 is the person's right corner of the mouth
    assert smile[54].norm() < 0.5 * smile[48].norm()
