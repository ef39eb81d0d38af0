from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hair_stand_ins import CLOTHES, HAIR, SKIN, ColourParser, draw_person

from dynhair.errors import DynhairError
from dynhair.preprocess.hair import HairClassifier, HairTeacher, PaintedView, confident_labels, facing
from dynhair.preprocess.hair import labels as label
from dynhair.preprocess.hair.patches import SIDE, LabelledView, PatchSource, streaks

PEOPLE = [draw_person(seed) for seed in range(8)]
VIEWS = [person.view for person in PEOPLE]


@pytest.fixture(scope="module")
def classifier() -> HairClassifier:
    return HairTeacher(ColourParser(), steps=40).teach(VIEWS)


def quick(**options: Any) -> HairClassifier:
    return HairTeacher(ColourParser(), steps=2).teach(VIEWS[:4], **options)


def answers(classifier: HairClassifier) -> np.ndarray:
    return classifier(PEOPLE[0].image, PEOPLE[0].mask)


@pytest.mark.parametrize("from_behind", [False, True])
def test_hair_is_found_in_other_views_with_and_without_a_face(classifier: HairClassifier, from_behind: bool):
    for seed in (100, 101, 102):
        person = draw_person(seed, from_behind=from_behind)
        hair = classifier(person.image, person.mask) > 127
        assert (hair & person.hair).sum() / (hair | person.hair).sum() > 0.9


def test_hair_stays_inside_the_body(classifier: HairClassifier):
    person = PEOPLE[1]
    half = np.full_like(person.mask, 128)
    half[:, :64] = 0
    hair = classifier(person.image, half)
    assert hair.dtype == np.uint8
    assert (hair <= half).all()
    assert hair.any()
    assert not classifier(person.image, np.zeros_like(half)).any()


def test_any_size_is_classified(classifier: HairClassifier):
    person = PEOPLE[2]
    assert classifier(person.image[:101, :77].copy(), person.mask[:101, :77].copy()).shape == (101, 77)


def test_what_stands_behind_the_body_does_not_matter(classifier: HairClassifier):
    person = PEOPLE[3]
    elsewhere = np.where(person.mask[..., None] > 0, person.image, np.uint8(200))
    np.testing.assert_array_equal(classifier(elsewhere, person.mask), classifier(person.image, person.mask))


def test_teaching_is_deterministic_and_leaves_the_generator_alone():
    torch.manual_seed(5)
    state = torch.get_rng_state()
    first = answers(quick())
    assert torch.equal(torch.get_rng_state(), state)
    torch.manual_seed(6)
    np.testing.assert_array_equal(answers(quick()), first)
    other = HairTeacher(ColourParser(), steps=2, seed=1).teach(VIEWS[:4])
    assert (answers(other) != first).any()


def test_a_saved_classifier_is_the_same(classifier: HairClassifier, tmp_path: Path):
    path = tmp_path / "classifier.safetensors"
    classifier.save(path)
    np.testing.assert_array_equal(answers(HairClassifier.load(path)), answers(classifier))


def test_files_of_other_kinds_are_refused(classifier: HairClassifier, tmp_path: Path):
    path = tmp_path / "classifier.safetensors"
    with pytest.raises(DynhairError, match="not readable"):
        HairClassifier.load(path)
    path.write_bytes(b"nothing of the kind")
    with pytest.raises(DynhairError, match="not readable"):
        HairClassifier.load(path)
    classifier.save(path)
    path.write_bytes(path.read_bytes().replace(b'version\\": 1', b'version\\": 9'))
    with pytest.raises(DynhairError, match="describes itself"):
        HairClassifier.load(path)


def test_painted_examples_outweigh_the_parser():
    """Somebody paints the clothes as hair and the hair as none."""
    examples = []
    for person in PEOPLE[:4]:
        blue = person.image[..., 2] > person.image[..., 0]
        examples.append(PaintedView(person.image, person.mask, np.where(blue, 255, 0).astype(np.uint8)))
    classifier = HairTeacher(ColourParser(sees_faces=False), steps=40).teach([], examples=examples)
    unseen = draw_person(200)
    hair = classifier(unseen.image, unseen.mask) > 127
    blue = unseen.image[..., 2] > unseen.image[..., 0]
    assert (hair & blue).sum() / (hair | blue).sum() > 0.8


def test_painted_examples_join_the_parsers_and_progress_is_told():
    told = []
    person = PEOPLE[5]
    painted = PaintedView(person.image, person.mask, np.where(person.hair, 255, 0).astype(np.uint8))
    with_example = quick(examples=[painted], progress=lambda done, steps: told.append((done, steps)))
    assert (answers(with_example) != answers(quick())).any()
    assert told[-2:] == [(told[-1][1] - 1, told[-1][1]), (told[-1][1], told[-1][1])], (
        "the last steps are those of training"
    )
    assert [done for done, _ in told] == sorted(done for done, _ in told)


def test_no_more_views_are_asked_for_than_are_learnt_from():
    samples = iter(VIEWS)
    HairTeacher(ColourParser(), views=5, steps=1).teach(samples)
    assert len(list(samples)) == len(VIEWS) - 5


def test_too_few_faces_are_refused():
    with pytest.raises(DynhairError, match="0 of 8 views"):
        HairTeacher(ColourParser(sees_faces=False)).teach(VIEWS)
    with pytest.raises(DynhairError, match="3 of 8 views"):
        HairTeacher(ColourParser()).teach([*VIEWS[:3], *(replace(view, score=0.5) for view in VIEWS[3:])])


def test_views_without_hair_are_refused():
    bald = [
        replace(view, image=np.where(person.hair[..., None], np.array(SKIN, np.uint8), view.image))
        for person, view in zip(PEOPLE, VIEWS, strict=True)
    ]
    with pytest.raises(DynhairError, match="both hair and others"):
        HairTeacher(ColourParser()).teach(bald)


def test_sure_labels_are_right_and_keep_off_borders_and_background():
    for person in PEOPLE[:3]:
        labels = confident_labels(ColourParser(), person.view)
        assert labels is not None
        known = labels != label.UNKNOWN
        assert ((labels == label.HAIR) == person.hair)[known].all()
        assert set(np.unique(labels)) == {label.UNKNOWN, label.HAIR, label.SKIN, label.CLOTHES}
        assert not known[person.mask == 0].any()
        borders = person.hair[:, 1:] != person.hair[:, :-1]
        assert not (known[:, 1:] & borders).any()


def test_labels_that_crops_disagree_on_are_unknown():
    class Undecided(ColourParser):
        def parse(self, image, square, *, scale=1.35, mirrored=False):
            swapped = np.roll(image, 1, axis=2) if mirrored else image  # clothes for skin, in the mirror only
            return super().parse(swapped, square, scale=scale, mirrored=mirrored)

    labels = confident_labels(Undecided(), PEOPLE[0].view)
    assert labels is not None
    assert label.CLOTHES not in labels


@pytest.mark.parametrize(("nose", "expected"), [(0.0, 1.0), (50.0, 1 / 3), (-50.0, 1 / 3), (100.0, 0.0)])
def test_facing(nose: float, expected: float):
    points = np.zeros((478, 3), np.float32)
    points[234, 0], points[454, 0], points[1, 0] = -100, 100, nose
    assert facing(points) == pytest.approx(expected)
    turned = np.array([[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 1]], np.float32)
    assert facing(points @ turned) == pytest.approx(expected, abs=1e-5)
    assert label.faces_camera(replace(VIEWS[0], points=points)) == (expected > 0.4)


def test_faces_without_extent_do_not_face_anything():
    assert facing(np.zeros((478, 3), np.float32)) == 0


def test_streaks_cover_a_part_with_thin_edges():
    rng = np.random.default_rng(0)
    covers = np.stack([streaks(rng) for _ in range(20)])
    assert covers.shape == (20, SIDE, SIDE)
    assert covers.min() == 0
    assert covers.max() == 1
    assert 0.3 < covers.mean() < 0.7
    assert ((covers > 0) & (covers < 1)).mean() < 0.5


def test_pasted_patches_tell_their_coverage():
    """With one colour for hair and one for skin, a pixel's brightness orders the pixels of a patch by coverage."""
    size = 400
    middle = np.zeros((size, size), np.uint8)
    middle[190:210, 190:210] = 1
    views = [
        LabelledView(
            np.full((size, size, 3), colour, np.uint8), np.full((size, size), 255, np.uint8), middle * np.uint8(kind)
        )
        for colour, kind in ((HAIR, label.HAIR), (SKIN, label.SKIN), (CLOTHES, label.CLOTHES))
    ]
    source = PatchSource(views, np.random.default_rng(0))
    assert source.teaches
    assert not PatchSource(views[1:], np.random.default_rng(0)).teaches
    colours, coverage, known = source.batch(200)
    assert colours.shape == (200, SIDE, SIDE, 3)
    assert set(np.unique(known)) == {0, 1}
    mixed = 0
    for patch, share, sure in zip(colours, coverage, known, strict=True):
        brightness, part = patch.mean(axis=-1)[sure > 0], share[sure > 0]
        order = np.argsort(part, kind="stable")
        assert (np.diff(brightness[order])[np.diff(part[order]) > 1e-3] < 1e-4).all()
        mixed += ((part > 0) & (part < 1)).any()
    assert mixed > 20
    assert 0.3 < coverage[known > 0].mean() < 0.7
