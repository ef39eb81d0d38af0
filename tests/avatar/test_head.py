"""The Gaussian head: branches, follow weights, attributes."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dynhair.avatar import ExpressionModes, Head, HeadPose, HeadStart
from dynhair.avatar.branches import Branches, expression_weight
from dynhair.avatar.encoding import positional_encoding
from dynhair.avatar.expression_modes import fitted_modes
from dynhair.avatar.head import facing
from dynhair.avatar.rotations import multiply_quaternions, rotation_quaternion
from dynhair.avatar.skinning import Skinning
from dynhair.config import HeadConfig
from dynhair.motion import so3_exp

CONFIG = HeadConfig(features=4, deformation_width=8, appearance_width=8)


def pose_of(vector: list[float], translation: list[float], expression: int = 3) -> HeadPose:
    turned = torch.tensor(vector)
    return HeadPose(so3_exp(turned), torch.tensor(translation), turned, torch.linspace(0.1, 0.9, expression))


REST = pose_of([0.0, 0.1, 0.0], [0.0, 0.7, 0.0])
TURNED = pose_of([0.2, 0.9, -0.1], [0.03, 0.68, 0.05])


def start(count: int = 60) -> HeadStart:
    generator = torch.Generator().manual_seed(0)
    normals = torch.nn.functional.normalize(torch.randn(count, 3, generator=generator), dim=1)
    return HeadStart(
        means=0.09 * normals,
        normals=normals,
        spacing=torch.full((count,), 0.01),
        colours=torch.rand(count, 3, generator=generator),
        opacities=torch.full((count,), 0.9),
        follow=torch.linspace(0, 1, count),
    )


@pytest.fixture
def head() -> Head:
    torch.manual_seed(0)
    return Head(start(), start().means[:5], REST, CONFIG)


def wild(module: torch.nn.Module) -> None:
    with torch.no_grad():
        for parameter in module.parameters():
            parameter.copy_(torch.randn_like(parameter))


def test_in_the_rest_frame_the_head_is_what_it_starts_from(head: Head) -> None:
    gaussians = head(REST)
    expected = start().means @ REST.rotation.T + REST.translation
    torch.testing.assert_close(gaussians.means, expected, atol=3e-4, rtol=0)  # networks say next to nothing
    torch.testing.assert_close(gaussians.colours, start().colours, atol=2e-2, rtol=0)
    torch.testing.assert_close(gaussians.opacities, start().opacities, atol=1e-2, rtol=0)
    turned = REST.rotation @ facing_matrices(facing(start().normals))
    actual = facing_matrices(gaussians.quats.detach())
    torch.testing.assert_close(actual, turned, atol=1e-2, rtol=0)


def facing_matrices(quats: torch.Tensor) -> torch.Tensor:
    return torch.from_numpy(Rotation.from_quat(np.roll(quats.numpy(), -1, 1)).as_matrix()).float()


def test_what_follows_the_head_moves_with_it_and_the_rest_stays(head: Head) -> None:
    assert head.follow_logits is not None
    torch.nn.init.constant_(head.follow_logits, -50.0)
    head.deformation.on_pose.apply(zero)
    head.deformation.on_expression.apply(zero)
    torch.testing.assert_close(head.world_means(TURNED), head.world_means(REST))
    torch.nn.init.constant_(head.follow_logits, 50.0)
    torch.testing.assert_close(head.world_means(TURNED), head.means @ TURNED.rotation.T + TURNED.translation)


def zero(module: torch.nn.Module) -> None:
    for parameter in module.parameters(recurse=False):
        torch.nn.init.zeros_(parameter)


def test_follow_weights_start_as_given_and_can_be_switched_off(head: Head) -> None:
    torch.testing.assert_close(head.follow, start().follow.clamp(0.002, 0.998))
    rigid = Head(start(), start().means[:5], REST, replace(CONFIG, follow_weights=False))
    assert torch.equal(rigid.follow, torch.ones(60))
    assert not any("follow" in name for name, _ in rigid.named_parameters())
    rigid.deformation.on_pose.apply(zero)
    rigid.deformation.on_expression.apply(zero)
    torch.testing.assert_close(rigid.world_means(TURNED), rigid.means @ TURNED.rotation.T + TURNED.translation)


def test_displacements_are_bounded(head: Head) -> None:
    wild(head.deformation)
    skinned = head.skinning.world(head.means, head.follow, TURNED)
    assert (head.world_means(TURNED) - skinned).abs().max() <= 3**0.5 * CONFIG.deformation_scale


def test_expression_modes_displace_what_they_know_and_nothing_at_rest(head: Head) -> None:
    rows, offsets = torch.tensor([4, 9]), torch.rand(1, 2, 3) * 0.01
    turns, growth = torch.rand(1, 2, 3), torch.rand(1, 2)
    modes = ExpressionModes(rows, torch.tensor([2]), REST.expression, offsets, turns, growth)
    moving = Head(replace(start(), modes=modes), start().means[:5], REST, CONFIG)
    moving.deformation.load_state_dict(head.deformation.state_dict())
    smiling = replace(REST, expression=REST.expression + torch.tensor([0.7, 0.0, 0.5]))
    torch.testing.assert_close(moving.world_means(REST), head.world_means(REST))
    change = moving.world_means(smiling) - head.world_means(smiling)
    expected = torch.zeros(60, 3)
    expected[rows] = 0.5 * offsets[0] @ REST.rotation.T
    torch.testing.assert_close(change, expected, atol=1e-6, rtol=0)

    for part in (moving, head):
        part.attributes.apply(zero)
    before, after = head(smiling), moving(smiling)
    torch.testing.assert_close(after.scales[rows], before.scales[rows] * (0.5 * growth[0, :, None]).exp())
    turn = Rotation.from_rotvec(0.5 * turns[0].numpy() @ REST.rotation.numpy().T)
    expected = turn.as_matrix() @ facing_matrices(before.quats.detach()[rows]).numpy()
    np.testing.assert_allclose(facing_matrices(after.quats.detach()[rows]).numpy(), expected, atol=1e-5)
    others = torch.ones(60, dtype=torch.bool)
    others[rows] = False
    torch.testing.assert_close(after.quats[others], before.quats[others])


def test_modes_are_found_again_from_what_they_displaced() -> None:
    generator = torch.Generator().manual_seed(0)
    true = torch.randn(3, 7, 3, generator=generator) * 0.01
    expressions = torch.zeros(40, 5)
    expressions[:, [0, 1, 4]] = torch.rand(40, 3, generator=generator)
    rest = expressions[6]
    displacements = torch.einsum("fa,amc->fmc", (expressions - rest)[:, [0, 1, 4]], true)
    turns, growth = 10 * displacements, 20 * displacements[..., 0]
    modes = fitted_modes(expressions, rest, displacements, turns, growth, torch.arange(7), 1e-9)
    assert modes.coefficients.tolist() == [0, 1, 4]  # those that never change teach nothing
    torch.testing.assert_close(modes.offsets.detach(), true, atol=1e-6, rtol=0)
    torch.testing.assert_close(modes.turns, 10 * true, atol=1e-5, rtol=0)
    torch.testing.assert_close(modes.growth, 20 * true[..., 0], atol=1e-5, rtol=0)
    shrunk = fitted_modes(expressions, rest, displacements, turns, growth, torch.arange(7), 1e3)
    assert shrunk.offsets.abs().max() < 1e-3
    nothing = torch.zeros(4, 7, 3)
    still = fitted_modes(rest.expand(4, 5), rest, nothing, nothing, nothing[..., 0], torch.arange(7), 1e-3)
    assert still.displaced(torch.ones(8, 3), rest + 1).equal(torch.ones(8, 3))


def test_every_parameter_of_the_head_is_taught(head: Head) -> None:
    gaussians = head(TURNED)
    parts = (gaussians.means, gaussians.scales, gaussians.quats, gaussians.opacities, gaussians.colours)
    torch.stack([(part * torch.randn_like(part)).sum() for part in parts]).sum().backward()
    for name, parameter in head.named_parameters():
        assert parameter.grad is not None, name
        assert parameter.grad.abs().sum() > 0 or not parameter.numel(), name


def test_more_channels_than_colours_begin_dark() -> None:
    head = Head(start(), start().means[:5], REST, replace(CONFIG, super_resolution=2))
    colours = head(REST).colours
    assert colours.shape == (60, 32)
    assert colours[:, 3:].abs().max() < 0.05


@given(st.floats(0, 1), st.integers(1, 6), st.booleans())
def test_branches_are_blended_by_weight(share: float, expression: int, bounded: bool) -> None:
    torch.manual_seed(0)
    pair = Branches(5, expression, 4, (6, 7), (8,), 3, bounded=bounded)
    wild(pair)
    points, coefficients, code = torch.randn(9, 5), torch.randn(expression), torch.randn(4)
    a, b = pair.on_expression(points, coefficients), pair.on_pose(points, code)
    if bounded:
        a, b = a.tanh(), b.tanh()
    weight = torch.full((9,), share)
    weight[:2] = torch.tensor([0.0, 1.0])
    expected = weight[:, None] * a + (1 - weight[:, None]) * b
    torch.testing.assert_close(pair(points, weight, coefficients, code), expected)


def test_a_branch_is_not_asked_about_points_that_it_has_no_say_in() -> None:
    pair = Branches(2, 1, 1, (4,), (4,), 3)
    asked: list[int] = []
    pair.on_expression.register_forward_pre_hook(lambda _, inputs: asked.append(len(inputs[0])))
    pair.on_pose.register_forward_pre_hook(lambda _, inputs: asked.append(len(inputs[0])))
    pair(torch.randn(5, 2), torch.tensor([0.0, 1.0, 1.0, 0.5, 0.0]), torch.ones(1), torch.ones(1))
    assert asked == [3, 3]


def test_the_expressions_share_falls_with_distance_to_the_landmarks() -> None:
    points = torch.tensor([[0.0, 0, 0], [0, 0, 0.03], [0, 0, 0.04], [0, 0, 0.05], [0, 0, 0.3], [0.2, 0, 0.301]])
    landmarks = torch.tensor([[0.0, 0, 0], [0.2, 0, 0.3]])
    weight = expression_weight(points, landmarks, 0.03, 0.05)
    torch.testing.assert_close(weight, torch.tensor([1.0, 1, 0.5, 0, 0, 1]))


def test_discs_face_along_their_normals() -> None:
    normals = torch.nn.functional.normalize(torch.randn(50, 3, generator=torch.Generator().manual_seed(0)), dim=1)
    normals = torch.cat([normals, torch.tensor([[0.0, 0, 1], [0, 0, -1], [1, 0, 0]])])
    turned = Rotation.from_quat(np.roll(facing(normals).numpy(), -1, axis=1)).apply([0, 0, 1])
    np.testing.assert_allclose(np.abs((turned * normals.numpy()).sum(1)), 1, atol=1e-6)


def test_the_body_answers_the_head_linearly() -> None:
    skinning = Skinning(REST)
    rotation, translation = skinning.body(TURNED)
    torch.testing.assert_close(rotation, REST.rotation)
    torch.testing.assert_close(translation, REST.translation)
    torch.nn.init.eye_(skinning.body_response)  # a body that moves as the head does
    rotation, translation = skinning.body(TURNED)
    torch.testing.assert_close(rotation, TURNED.rotation)
    torch.testing.assert_close(translation, TURNED.translation)


@pytest.mark.parametrize("pose", [REST, TURNED, pose_of([0.0, 0.0, 0.0], [0.0, 0.7, 0.0])])
def test_skinning_has_finite_gradients_everywhere(pose: HeadPose) -> None:
    skinning = Skinning(pose_of([0.0, 0.0, 0.0], [0.0, 0.7, 0.0]))
    change = torch.zeros(6, requires_grad=True)
    moved = pose.corrected(change)
    points, follow = torch.randn(7, 3), torch.rand(7)
    quats = torch.nn.functional.normalize(torch.randn(7, 4), dim=1)
    placement = skinning.placement(moved)
    (placement.moved(points, follow).square().sum() + placement.turned(quats, follow)[:, 0].sum()).backward()
    for gradient in (change.grad, skinning.body_response.grad):
        assert gradient is not None
        assert torch.isfinite(gradient).all()


def test_discs_turn_as_their_points_do() -> None:
    skinning = Skinning(REST)
    wild(skinning)
    skinning.body_response.data *= 0.1
    quats = torch.nn.functional.normalize(torch.randn(9, 4), dim=1)
    axes = facing_matrices(quats)
    for share in (0.0, 1.0):  # between, the blend of two rotations is no rotation, and its nearest one is taken
        follow = torch.full((9,), share)
        origin = skinning.world(torch.zeros(9, 3), follow, TURNED)
        tips = torch.stack([skinning.world(axes[:, :, axis], follow, TURNED) - origin for axis in range(3)], 2)
        turned = facing_matrices(skinning.placement(TURNED).turned(quats, follow).detach())
        torch.testing.assert_close(turned, tips.detach(), atol=1e-5, rtol=0)


def test_between_head_and_body_discs_turn_half_way() -> None:
    skinning = Skinning(pose_of([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]))
    identity = torch.tensor([[1.0, 0, 0, 0]])
    half = skinning.placement(pose_of([0.0, 0.8, 0.0], [0.0, 0.0, 0.0])).turned(identity, torch.tensor([0.5]))
    torch.testing.assert_close(half[0], rotation_quaternion(torch.tensor([0.0, 0.4, 0.0])))


def test_a_corrected_pose_is_turned_about_the_heads_origin() -> None:
    change = torch.tensor([0.1, -0.2, 0.05, 0.01, 0.02, -0.03])
    moved = TURNED.corrected(change)
    expected = Rotation.from_rotvec(change[:3].numpy()) * Rotation.from_matrix(TURNED.rotation.numpy())
    np.testing.assert_allclose(moved.rotation.numpy(), expected.as_matrix(), atol=1e-6)
    np.testing.assert_allclose(moved.rotation_vector.numpy(), expected.as_rotvec(), atol=1e-6)
    torch.testing.assert_close(moved.translation, TURNED.translation + change[3:])


def test_quaternions_are_scipys() -> None:
    rotations = Rotation.from_rotvec(np.random.default_rng(0).normal(size=(6, 3)))
    wxyz = torch.from_numpy(np.roll(rotations.as_quat(), 1, axis=1))
    product = multiply_quaternions(wxyz[0], wxyz[1:])
    expected = np.roll((rotations[0] * rotations[1:]).as_quat(), 1, axis=1)
    sign = np.sign((product.numpy() * expected).sum(1, keepdims=True))
    np.testing.assert_allclose(product.numpy(), expected * sign, atol=1e-12)
    for vector, quaternion in zip(rotations.as_rotvec(), wxyz, strict=True):
        assert abs(abs(rotation_quaternion(torch.from_numpy(vector)) @ quaternion) - 1) < 1e-12
    torch.testing.assert_close(rotation_quaternion(torch.zeros(3)), torch.tensor([1.0, 0, 0, 0]))


@pytest.mark.parametrize("size", [1, 52, 64, 100])  # Anny has 52 coefficients, BFM 64, FLAME up to 100
def test_expression_bases_of_any_size(size: int) -> None:
    rest = pose_of([0.0, 0.1, 0.0], [0.0, 0.7, 0.0], expression=size)
    head = Head(start(), start().means[:5], rest, CONFIG)
    with torch.no_grad():
        for parameter in head.deformation.parameters():
            parameter.normal_(std=0.1)  # little enough for tanh not to saturate
    other = replace(rest, expression=rest.expression.roll(1) + 0.3)
    near = head.expression_weight > 0.5
    assert near.any()
    assert (head.world_means(other) - head.world_means(rest))[near].abs().max() > 1e-6


@pytest.mark.parametrize("order", ["sorted", "shuffled"])
def test_gradients_of_blended_branches(order: str) -> None:
    torch.manual_seed(0)
    pair = Branches(3, 2, 2, (4,), (4,), 2, bounded=True).double()
    wild(pair)
    weight = torch.tensor([1.0, 1.0, 0.6, 0.2, 0.0, 0.0], dtype=torch.float64)
    if order == "shuffled":
        weight = weight[torch.tensor([4, 0, 2, 5, 3, 1])]
    points, expression, code = (torch.randn(*size, dtype=torch.float64) for size in ((6, 3), (2,), (2,)))
    inputs = [tensor.requires_grad_() for tensor in (points, expression, code)]
    assert torch.autograd.gradcheck(lambda p, e, c: pair(p, weight, e, c), inputs)


def test_gradients_of_the_positional_encoding() -> None:
    x = torch.randn(5, 2, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda x: positional_encoding(x, 3), (x,))


def expressive(count: int, config: HeadConfig = CONFIG) -> Head:
    """A head four of whose Gaussians move, turn and grow with the expression."""
    torch.manual_seed(count)
    vectors = torch.randn(2, 4, 3)
    some = torch.tensor([3, 0, 4, 2])
    modes = ExpressionModes(
        some, torch.tensor([0, 2]), REST.expression, 0.01 * vectors, 0.3 * vectors, 0.1 * vectors[..., 0]
    )
    head = Head(replace(start(count), modes=modes), start(count).means[:5], REST, config)
    with torch.no_grad():
        for parameter in head.parameters():
            parameter.add_(0.1 * torch.randn_like(parameter))
    return head


def test_an_expression_that_is_fitted_gets_its_whole_gradient() -> None:
    quick = expressive(20)
    found = []
    for head in (quick, copy.deepcopy(quick).double()):
        pose = HeadPose(*[part.to(head.means, copy=True) for part in vars(TURNED).values()])
        pose.expression.add_(torch.arange(3) / 5).requires_grad_()
        posed = head(pose)
        (posed.scales.sum() + posed.quats[:, 1].sum()).backward()  # what the expression's turns and growth change
        assert pose.expression.grad is not None
        found.append(pose.expression.grad.double())
    torch.testing.assert_close(found[0], found[1], rtol=1e-4, atol=1e-5)
    assert found[1].abs().max() > 1e-3


@pytest.mark.parametrize("count", [5, 16, 60])
@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("follow_weights", [True, False])
def test_the_compiled_pose_has_the_values_and_gradients_of_the_plain_formulas(
    count: int, threads: int, follow_weights: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dynhair.threads.thread_count", lambda: threads)
    quick = expressive(count, replace(CONFIG, follow_weights=follow_weights))
    plain = copy.deepcopy(quick).double()
    names = "rotation", "translation", "rotation_vector"
    found: list[dict[str, torch.Tensor]] = []
    for head, dtype in ((quick, torch.float32), (plain, torch.float64)):
        moving = {name: getattr(TURNED, name).clone().to(dtype).requires_grad_() for name in names}
        posed = head(replace(TURNED, expression=TURNED.expression.flip(0).to(dtype), **moving))
        generator = torch.Generator().manual_seed(1)
        values = {name: getattr(posed, name) for name in ("means", "scales", "quats", "opacities", "colours")}
        weights = [torch.randn(value.shape, generator=generator) for value in values.values()]
        torch.autograd.backward(list(values.values()), [weight.to(dtype) for weight in weights])
        gradients = dict(head.named_parameters()) | moving
        found.append(values | {f"of {name}": p.grad for name, p in gradients.items() if p.grad is not None})
    assert found[0].keys() == found[1].keys()
    for name, expected in found[1].items():
        most = float(expected.detach().abs().max())
        torch.testing.assert_close(found[0][name].double(), expected, rtol=1e-4, atol=2e-5 * most)
