"""Fitting a morphable head to the landmarks of all views of all frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray

from dynhair.errors import DynhairError
from dynhair.face import FaceModel
from dynhair.face.anchors import Anchors
from dynhair.preprocess.tracking import initial
from dynhair.preprocess.tracking.anchored_head import AnchoredHead, Person
from dynhair.preprocess.tracking.diagnostics import diagnose
from dynhair.preprocess.tracking.expression_prior import ExpressionPrior
from dynhair.preprocess.tracking.head_motion import HeadMotion
from dynhair.preprocess.tracking.noise import NoiseLevels, PoseMeasurements, estimate_noise, posterior_noise
from dynhair.preprocess.tracking.observations import Observations
from dynhair.preprocess.tracking.person_fit import PersonProblem, offset_precision
from dynhair.preprocess.tracking.reprojection import Reprojection, project
from dynhair.preprocess.tracking.result import TrackingResult, facing_yaw
from dynhair.preprocess.tracking.silhouette import Silhouettes, skin_vertices
from dynhair.preprocess.tracking.smoother import SmoothingProblem
from dynhair.preprocess.tracking.smoothness import Smoothness
from dynhair.preprocess.tracking.split_noise import split_noise
from dynhair.preprocess.tracking.take_track import TakeTrack

_SMALLEST_FACE = 10.0  # pixels
_BELIEVED = 0.3  # a frame is lost if the median landmark of its best view is believed less
_ROUNDS = 3  # of smoothing; between them its strength is found
_MASK_NOISE = 0.01  # of the face's side
_INDEPENDENT_LANDMARKS = 12.0  # in a view: a detector's errors have few degrees of freedom, whatever its points
_INDEPENDENT_FRAMES = 20.0  # of a recording: what is wrong about a head's direction is wrong whenever it is taken
_FIRST_GUESS = NoiseLevels(confidence=1.0, angular_jerk=30.0, linear_jerk=1.0)

Masks = Callable[[int, int, int], UInt8[ndarray, "h w"]]


@dataclass(frozen=True)
class TrackingOptions:
    """What is expected of landmarks and of faces.

    Attributes:
        landmark_noise: error of a landmark relative to the side of the face in the image.
        hint_deviation: error of the expressions that the detector guesses, in their own units.
        angular_jerk: how much heads jerk, as the square root of the jerk's spectral density, rad / s^2.5; found from
            the landmarks by default. Less is smoother.
        linear_jerk: the same for the position of the head, m / s^2.5.
        expression_acceleration: the same for the acceleration of expressions, 1 / s^1.5: the default lets an eyelid
            close in a tenth of a second.
        landmark_count: how many landmarks to use at most, evenly spread over the face. Neighbours err together, so that
            more cost time and say little.
        person_frames: how many frames, evenly taken of all, tell the identity.
    """

    landmark_noise: float = 0.015
    hint_deviation: float = 0.2
    angular_jerk: float | None = None
    linear_jerk: float | None = None
    expression_acceleration: float = 30.0
    landmark_count: int = 150
    person_frames: int = 240


def track_head(
    takes: Sequence[Observations],
    model: FaceModel,
    anchors: Anchors,
    options: TrackingOptions | None = None,
    *,
    masks: Masks | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> TrackingResult:
    """Fit a morphable head to the landmarks of all views of all frames of all takes of one person.

    First guesses come from each view alone, then from what views agree on. Then size, identity and the landmarks'
    offsets are fitted to frames from all takes, each with its own pose and expression. With these, each take's motion
    is smoothed as a whole, forwards and backwards in time alike, so that it has no lag; how much, landmarks tell. As
    poses become known, the detector's drift with the side that it sees the face from is taken out of the landmarks.

    Args:
        takes: landmarks of each take.
        model: the face model.
        anchors: where on the model the detector's landmarks lie.
        options: see there.
        masks: coverage by the body in a take, frame and view (0, 1, ...). If given, they hold the bare head in.
        progress: called with steps done and steps in all.

    Raises:
        DynhairError: a take has no face in any view, or the takes do not fit the anchors.
    """
    options = options or TrackingOptions()
    steps = 2 + _ROUNDS * len(takes)
    anchors = _spread(model, anchors, options.landmark_count)
    takes = [_with_anchors_only(take, anchors) for take in takes]
    head = AnchoredHead.of(model, anchors)
    person, motions, faces = _first_guess(takes, head, model)
    data = [_reprojection(take, sizes, options) for take, sizes in zip(takes, faces, strict=True)]
    data = _without_drift(data, takes, anchors, head, person, motions)
    priors = [_expression_prior(take, model, options) for take in takes]
    progress(1, steps)
    person, noise_factors = _fit_person(person, head, motions, data, priors, anchors, options)
    data = [d.blurred(noise_factors) for d in data]
    progress(2, steps)

    levels = [_with_given(_FIRST_GUESS, options)] * len(takes)
    sureness = min(1.0, _INDEPENDENT_LANDMARKS / len(head.mean))
    problems = [
        SmoothingProblem(head, person, d, sureness, prior, _smoothness(level, take, options))
        for take, d, prior, level in zip(takes, data, priors, levels, strict=True)
    ]

    def smooth(round_: int) -> list[PoseMeasurements]:
        for index, problem in enumerate(problems):
            motions[index] = problem.solve(motions[index])
            progress(3 + round_ * len(takes) + index, steps)
        return list(map(_measurements, problems, motions))

    def follow_drift() -> None:
        found = _without_drift([p.data for p in problems], takes, anchors, head, person, motions)
        problems[:] = [replace(problem, data=d) for problem, d in zip(problems, found, strict=True)]

    for round_ in range(_ROUNDS - 1):
        follow_drift()
        levels = [_with_given(level, options) for level in estimate_noise(smooth(round_), levels[0])]
        problems = [
            replace(problem, smoothness=_smoothness(level, take, options))
            for problem, level, take in zip(problems, levels, takes, strict=True)
        ]
    follow_drift()
    if masks is not None:
        problems = [_within_masks(p, model, masks, index, faces[index]) for index, p in enumerate(problems)]
    measured = smooth(_ROUNDS - 1)
    tracks = tuple(map(_take_track, takes, problems, motions, faces))
    return TrackingResult(
        model=model,
        person=person,
        takes=tracks,
        body_rotation=facing_yaw(np.concatenate([motion.rotations for motion in motions])),
        noise=tuple(levels),
        rotation_noise=split_noise(problems, motions) or posterior_noise(measured, levels),
        diagnostics=diagnose(
            tracks, [p.data for p in problems], [p.points(m) for p, m in zip(problems, motions, strict=True)]
        ),
    )


def _spread(model: FaceModel, anchors: Anchors, count: int) -> Anchors:
    """Anchors as far from each other as may be (farthest-point sampling)."""
    if len(anchors.points) <= count:
        return anchors
    places = AnchoredHead.of(model, anchors).mean
    chosen = [int(anchors.deviation.argmin())]
    distance = np.full(len(places), np.inf)
    while len(chosen) < count:
        distance = np.minimum(distance, np.linalg.norm(places - places[chosen[-1]], axis=1))
        chosen.append(int(distance.argmax()))
    return anchors.at(np.sort(chosen))


def _with_anchors_only(take: Observations, anchors: Anchors) -> Observations:
    if take.points.shape[2] <= anchors.points.max():
        raise DynhairError(
            f"{take.name}: {take.points.shape[2]} landmarks",
            expected=f"at least the {anchors.points.max() + 1} that the anchors are about",
        )
    if not (take.scores[:, :, anchors.points] > 0).any():
        raise DynhairError(
            f"{take.name}: no face was found in any frame of any view",
            expected="a face in at least one view of some frame",
            mend="leave the take out, or look at its pictures: too dark, too small, upside down?",
        )
    return replace(take, points=take.points[:, :, anchors.points], scores=take.scores[:, :, anchors.points])


def _first_guess(
    takes: Sequence[Observations], head: AnchoredHead, model: FaceModel
) -> tuple[Person, list[HeadMotion], list[Float[ndarray, "f v"]]]:
    """The average head at the person's size, poses, and the face's size in each view (0 where there is none)."""
    poses = [initial.view_poses(head.mean, take) for take in takes]
    scale = initial.agreed_scale(takes, poses)
    motions = []
    for take, guess in zip(takes, poses, strict=True):
        known = np.any(guess.trust > 0, axis=1)
        if not known.any():
            raise DynhairError(
                f"{take.name}: the landmarks of no view look like a face",
                expected="six landmarks of a face in at least one view of some frame",
            )
        rotations, translations = initial.bridge(
            initial.agreed_rotations(guess), initial.agreed_positions(take, guess, scale), known
        )
        hints = take.expression_hints
        neutral = np.zeros((take.frame_count, head.expression_modes.shape[-1]))
        motions.append(HeadMotion(rotations, translations, neutral if hints is None else hints.astype(np.float64)))
    faces = [np.where(guess.trust > 0, guess.sizes, 0.0) for guess in poses]
    return replace(head.average_person(), scale=scale), motions, faces


def _reprojection(take: Observations, sizes: Float[ndarray, "f v"], options: TrackingOptions) -> Reprojection:
    deviations = options.landmark_noise * np.maximum(sizes, _SMALLEST_FACE)
    return Reprojection(
        landmarks=take.points,
        scores=np.where(sizes[..., None] > 0, take.scores, 0.0),
        deviations=np.repeat(deviations[..., None], take.scores.shape[2], 2),
        w2c=take.w2c,
        K=take.K,
    )


def _without_drift(
    data: Sequence[Reprojection],
    takes: Sequence[Observations],
    anchors: Anchors,
    head: AnchoredHead,
    person: Person,
    motions: Sequence[HeadMotion],
) -> list[Reprojection]:
    """The landmarks as they would be if the detector put them on their anchors from wherever a camera looks."""
    cleaned = []
    for part, take, motion in zip(data, takes, motions, strict=True):
        points = motion.to_world(head.points(person, motion.expressions))
        cameras = -np.einsum("fvji,fvj->fvi", take.w2c[..., :3], take.w2c[..., 3])
        towards = cameras - points.mean(1)[:, None]
        sight = (towards / np.linalg.norm(towards, axis=-1, keepdims=True)) @ motion.rotations
        moved = person.scale * anchors.displacements(sight) @ motion.rotations.swapaxes(-1, -2)[:, None]
        drifted = [
            project(points + moved[:, view], take.w2c[:, [view]], take.K[:, [view]])[0]
            for view in range(sight.shape[1])
        ]
        shifts = np.concatenate(drifted, 1) - project(points, take.w2c, take.K)[0]
        cleaned.append(replace(part, landmarks=take.points - shifts))
    return cleaned


def _expression_prior(take: Observations, model: FaceModel, options: TrackingOptions) -> ExpressionPrior:
    if take.expression_hints is None:
        neutral = np.zeros((take.frame_count, len(model.expression_modes)))
        return ExpressionPrior(neutral, model.expression_deviation, model.expression_range)
    return ExpressionPrior(take.expression_hints.astype(np.float64), options.hint_deviation, model.expression_range)


def _fit_person(
    person: Person,
    head: AnchoredHead,
    motions: Sequence[HeadMotion],
    data: Sequence[Reprojection],
    priors: Sequence[ExpressionPrior],
    anchors: Anchors,
    options: TrackingOptions,
) -> tuple[Person, Float[ndarray, " n"]]:
    """The person, from some frames of all takes, and each landmark's noise relative to what was expected."""
    seen = [np.flatnonzero(d.scores.any((1, 2))) for d in data]
    stride = max(1, -(-sum(map(len, seen)) // options.person_frames))
    chosen = [frames[min(stride, len(frames)) // 2 :: stride] for frames in seen]
    count = sum(map(len, chosen))
    problem = PersonProblem(
        head=head,
        data=Reprojection.joined([d.at(frames) for d, frames in zip(data, chosen, strict=True)]),
        confidence=min(1.0, _INDEPENDENT_LANDMARKS / len(head.mean)) * min(1.0, _INDEPENDENT_FRAMES / count),
        expression_prior=ExpressionPrior.joined([p.at(frames) for p, frames in zip(priors, chosen, strict=True)]),
        offset_precision=offset_precision(head.mean, anchors.deviation),
    )
    motion = HeadMotion.joined([m.at(frames) for m, frames in zip(motions, chosen, strict=True)])
    factors = np.ones(len(head.mean))
    for blur in (4.0, 1.0, 1.0):
        data_now = problem.data.blurred(blur * factors)
        person, motion = replace(problem, data=data_now).solve(person, motion)
        points = motion.to_world(head.points(person, motion.expressions))
        factors = problem.data.blurred(factors).noise_factors(points) * factors
    return person, factors


def _smoothness(levels: NoiseLevels, take: Observations, options: TrackingOptions) -> Smoothness:
    # What counts is how the jerk compares with the landmarks' errors. Expressions go by the landmarks' own confidence.
    relative = levels.confidence**0.5
    return Smoothness(
        angular_jerk=relative * levels.angular_jerk,
        linear_jerk=relative * levels.linear_jerk,
        expression_acceleration=options.expression_acceleration,
        fps=take.fps,
    )


def _with_given(levels: NoiseLevels, options: TrackingOptions) -> NoiseLevels:
    return replace(
        levels,
        angular_jerk=options.angular_jerk or levels.angular_jerk,
        linear_jerk=options.linear_jerk or levels.linear_jerk,
    )


def _measurements(problem: SmoothingProblem, motion: HeadMotion) -> PoseMeasurements:
    equations = problem.frame_equations(motion)
    return PoseMeasurements.of(motion, equations, problem.smoothness.fps)


def _within_masks(
    problem: SmoothingProblem, model: FaceModel, masks: Masks, take: int, sizes: Float[ndarray, "f v"]
) -> SmoothingProblem:
    silhouettes = Silhouettes.of_masks(
        lambda frame, view: masks(take, frame, view),
        _MASK_NOISE * np.maximum(sizes, _SMALLEST_FACE),
        problem.data.w2c,
        problem.data.K,
    )
    return replace(problem, outline=(AnchoredHead.of_vertices(model, skin_vertices(model)), silhouettes))


def _take_track(
    take: Observations, problem: SmoothingProblem, motion: HeadMotion, sizes: Float[ndarray, "f v"]
) -> TakeTrack:
    points = problem.points(motion)
    believed = problem.data.belief(points)
    return TakeTrack(
        name=take.name,
        motion=motion,
        residuals=problem.data.residuals(points),
        belief=believed,
        face_sizes=sizes,
        lost=_lost(believed, problem.data.scores),
        body_position=np.median(motion.translations, axis=0),
        fps=take.fps,
    )


def _lost(belief: Float[ndarray, "f v n"], scores: Float[ndarray, "f v n"]) -> Bool[ndarray, " f"]:
    """Frames where in no view most landmarks agree with the pose."""
    relative = np.where(scores > 0, belief / np.maximum(scores, 1e-12), np.nan)
    seen = (scores > 0).any(2)
    typical = np.zeros(seen.shape)
    typical[seen] = np.nanmedian(relative[seen], axis=-1)
    return np.max(typical, axis=1) < _BELIEVED
