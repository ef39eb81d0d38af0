"""Where crops lie, and that the perceptual loss sees them alone."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from dynhair.errors import DynhairError
from dynhair.losses import PerceptualDistance, perceptual_crop_loss, random_crops


def seeded(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


@given(st.integers(1, 40), st.integers(1, 40), st.integers(1, 50), st.integers(0, 1000))
def test_crops_have_their_size_and_hold_the_pixel_they_were_drawn_about(
    height: int, width: int, size: int, seed: int
) -> None:
    person = torch.zeros(3, height, width)
    places = torch.randint(height * width, (3,), generator=seeded(seed))
    person.flatten(1)[torch.arange(3), places] = 1
    for view, (rows, columns) in enumerate(random_crops(person, size, generator=seeded(seed))):
        cut = person[view, rows, columns]
        assert cut.shape == (min(size, height), min(size, width))
        assert cut.sum() == 1
        row, column = divmod(int(places[view]), width)
        for place, span, extent in ((row, rows, height), (column, columns, width)):
            assert 0 <= span.start < span.stop <= extent
            if size // 2 <= place <= extent - size + size // 2:
                assert span.start == place - size // 2


def test_pixels_of_the_person_are_drawn_alike_in_each_view_on_its_own() -> None:
    person = torch.zeros(2, 30, 30)
    person[0, 10:14, 10:15], person[1, 5, 7], person[1, 20, 21] = 1.0, 0.6, 0.4  # the last does not show enough of it
    counts, generator = torch.zeros(30, 30), seeded()
    for _ in range(2000):
        (rows, columns), second = random_crops(person, 5, generator=generator)
        counts[rows.start + 2, columns.start + 2] += 1
        assert second == (slice(3, 8), slice(5, 10))
    assert counts[10:14, 10:15].sum() == 2000
    assert counts[10:14, 10:15].min() > 60
    assert counts.max() < 150


def test_views_without_the_person_are_drawn_from_all_over() -> None:
    starts = {random_crops(torch.zeros(1, 8, 8), 1, generator=seeded(seed))[0][0].start for seed in range(200)}
    assert starts == set(range(8))


def test_crops_follow_their_generator() -> None:
    person = torch.ones(2, 50, 60)
    first, again, other = (random_crops(person, 16, generator=seeded(seed)) for seed in (1, 1, 2))
    assert first == again != other
    assert first[0] != first[1]


def test_crops_without_pixels_get_an_error() -> None:
    with pytest.raises(DynhairError, match="crops of 0 pixels"):
        random_crops(torch.ones(1, 8, 8), 0, generator=seeded())


@pytest.fixture(scope="module")
def distance() -> PerceptualDistance:
    torch.manual_seed(0)
    return PerceptualDistance("vgg16").double()


def test_the_loss_is_that_of_the_crops_and_its_gradient_stays_in_them(distance: PerceptualDistance) -> None:
    predicted, target = torch.rand(2, 2, 24, 40, 3, generator=seeded(), dtype=torch.float64)
    crops = [(slice(3, 19), slice(20, 36)), (slice(0, 16), slice(4, 20))]
    target.requires_grad_()
    loss = perceptual_crop_loss(distance, predicted.requires_grad_(), target, crops)
    loss.backward()
    with torch.no_grad():
        views = zip(predicted, target, crops, strict=True)
        expected = sum(distance(seen[crop], known[crop]).item() for seen, known, crop in views) / 2
    assert loss.item() == pytest.approx(expected)
    assert target.grad is None
    assert predicted.grad is not None
    outside = predicted.grad.clone()
    for view, crop in enumerate(crops):
        assert (outside[view][crop] != 0).any(-1).all()
        outside[view][crop] = 0
    assert outside.abs().max() == 0


def test_views_on_threads_of_their_own_agree_with_one_batch(
    distance: PerceptualDistance, monkeypatch: pytest.MonkeyPatch
) -> None:
    predicted, target = torch.rand(2, 2, 16, 24, 3, generator=seeded(2), dtype=torch.float64)
    crops = random_crops(torch.ones(2, 16, 24), 16, generator=seeded())
    losses, gradients = [], []
    for threads in (1, 2):
        monkeypatch.setattr("dynhair.losses.crops.thread_count", lambda threads=threads: threads)
        monkeypatch.setattr("dynhair.threads.thread_count", lambda threads=threads: threads)
        seen = predicted.clone().requires_grad_()
        losses.append(perceptual_crop_loss(distance, seen, target, crops))
        (7 * losses[-1]).backward()
        gradients.append(seen.grad)
    torch.testing.assert_close(losses[1], losses[0])
    torch.testing.assert_close(gradients[1], gradients[0])
    with torch.no_grad():
        torch.testing.assert_close(perceptual_crop_loss(distance, predicted, target, crops), losses[0].detach())


@pytest.mark.parametrize("threads", [1, 2])
def test_gradients_agree_with_finite_differences(
    threads: int, distance: PerceptualDistance, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dynhair.losses.crops.thread_count", lambda: threads)
    predicted, target, direction = torch.rand(3, 2, 20, 24, 3, generator=seeded(3), dtype=torch.float64)
    crops = random_crops(torch.ones(2, 20, 24), 16, generator=seeded())
    loss = perceptual_crop_loss(distance, predicted.requires_grad_(), target, crops)
    (gradient,) = torch.autograd.grad(loss, predicted)
    step = 1e-6
    with torch.no_grad():
        ahead, behind = (
            perceptual_crop_loss(distance, predicted + sign * step * direction, target, crops) for sign in (1, -1)
        )
    assert (gradient * direction).sum().item() == pytest.approx(((ahead - behind) / (2 * step)).item(), rel=1e-4)


def test_an_image_smaller_than_the_crop_is_compared_whole(distance: PerceptualDistance) -> None:
    predicted, target = torch.rand(2, 2, 16, 20, 3, generator=seeded(1), dtype=torch.float64)
    crops = random_crops(torch.ones(2, 16, 20), 96, generator=seeded())
    whole = distance(predicted, target).mean()
    torch.testing.assert_close(perceptual_crop_loss(distance, predicted, target, crops), whole)


def test_crops_too_small_for_the_network_get_an_error(distance: PerceptualDistance) -> None:
    images = torch.rand(1, 40, 40, 3, dtype=torch.float64)
    with pytest.raises(DynhairError, match="15 x 15"):
        perceptual_crop_loss(distance, images, images, random_crops(torch.ones(1, 40, 40), 15, generator=seeded()))
