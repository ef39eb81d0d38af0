"""What can be chosen about an avatar and its training.

Lengths are metres. Loss weights are the paper's (supplement B); its squared lengths are in the face model's canonical
units of about 0.1 m, so a weight on a squared length in metres is the paper's divided by 0.1 squared.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

import yaml

from dynhair.errors import DynhairError
from dynhair.mesh_config import MeshHeadConfig
from dynhair.storage import atomic_file

DeformerKind = Literal["paper", "modal", "strands"]
"""``paper``'s network hears a window of motion, ``modal`` hair swings in learned damped modes, ``strands`` move by
dynamics that simulated hair has taught."""

HISTORIES: Mapping[DeformerKind, int] = {"paper": 20, "modal": 120, "strands": 120}
"""Frames that each looks back, if nothing else is said. The paper's are 5; with 20 its hair is better on motions that
training did not see. Modes forget: after 120 frames even the slowest keeps 1 % of a swing, as they begin. So does hair
that moves by dynamics: it has come to rest by then."""


@dataclass(frozen=True)
class DeformerConfig:
    """What moves the hair.

    Attributes:
        kind: ``paper``'s network, ``modal`` hair, of which ``signals``, ``encoder``, ``film``, ``signal_frequencies``
            and ``hidden`` say nothing, or dynamics of ``strands``, whose network has its own size.
        history: frames T before the current one that it depends on. Modes and strands forget what is older.
        signals: what it sees of the motion: ``velocity`` and acceleration, or the absolute ``pose`` (an ablation).
        acceleration: whether it sees the angular acceleration.
        gravity: whether it sees the relative direction of gravity.
        turn: whether modes or strands see how the head has turned since rest: what lies on the shoulders stays behind.
        encoder: what embeds the window: an ``lstm``, or an ``mlp`` over all its frames (an ablation).
        film: whether the embedding scales and shifts the points' features, or is one more feature of each.
        signal_frequencies: octaves of the encoding of motion signals.
        position_frequencies: octaves of the encoding of canonical positions.
        place_frequencies: octaves of the encoding of the place along a strand.
        hidden: size of the LSTM's state.
        width: size of the MLP's hidden layers.
        layers: number of the MLP's hidden layers.
        modes: number of modes.
        guides: number of strands that move by dynamics; the others follow them.
        taught: whether dynamics begin from what simulated hair has taught.
        knots: points of a strand that the network is evaluated at, a spline in between; all points if 0. The paper's
            is 0. On a trained avatar 8 of 32 cost a quarter and differ by 2.5 % of the motion's RMS.
        inextensible: whether displacements only turn the strands' segments, which keep their lengths, and roots stay
            where they are. The paper's hair stretches, and a term of the loss holds it back.
    """

    kind: DeformerKind = "paper"
    history: int = 5
    modes: int = 48
    guides: int = 150
    taught: bool = True
    signals: Literal["velocity", "pose"] = "velocity"
    acceleration: bool = True
    gravity: bool = True
    turn: bool = False
    encoder: Literal["lstm", "mlp"] = "lstm"
    film: bool = True
    signal_frequencies: int = 4
    position_frequencies: int = 6
    place_frequencies: int = 4
    hidden: int = 128
    width: int = 128
    layers: int = 2
    knots: int = 8
    inextensible: bool = False


@dataclass(frozen=True)
class HairConfig:
    """Strands and their Gaussians.

    Attributes:
        strands: number of strands.
        points: points L of a strand.
        dynamic: whether it moves against the head; if not, it is rigid.
        deformer: the network that moves it.
    """

    strands: int = 1500
    points: int = 32
    dynamic: bool = True
    deformer: DeformerConfig = field(default_factory=DeformerConfig)


@dataclass(frozen=True)
class StaticWeights:
    """Weights of the static stage's terms (supplement B, in metres).

    The paper counts hair beyond the mask by half. Counted fully, strands came closer to those of procedural hairstyles
    (F-score at 2 mm 0.683 against 0.671), so only the preset ``paper`` keeps its half.
    """

    rgb: float = 0.2
    ssim: float = 0.02
    perceptual: float = 0.0
    segmentation: float = 1.0
    segmentation_excess: float = 1.0
    orientation: float = 0.5
    penetration: float = 2000.0
    shape: float = 0.001
    smoothness: float = 0.1
    length: float = 0.1
    pca: float = 0.0001


@dataclass(frozen=True)
class StaticConfig:
    """The static stage: the canonical hairstyle from the views of the hair at rest.

    Attributes:
        prior: ``builtin``, or a file that ``dynhair prior`` made.
        encoder_iterations: steps that train the prior's encoders.
        style_generations: generations of the search for a procedural style.
        iterations: steps that move the strands themselves.
        views: views a step.
        image_size: longer side of the images, pixels; larger captures are reduced.
        encoder_rate: learning rate of the encoders.
        checkpoint_every: steps between checkpoints.
        weights: of the losses.
    """

    prior: str = "builtin"
    encoder_iterations: int = 100
    style_generations: int = 40
    iterations: int = 2000
    views: int = 2
    image_size: int = 512
    encoder_rate: float = 1e-5
    checkpoint_every: int = 250
    weights: StaticWeights = field(default_factory=StaticWeights)


@dataclass(frozen=True)
class HeadConfig:
    """Gaussians of head and upper body (paper, appendix A).

    Attributes:
        start: what the Gaussians begin on: the ``tracked`` mesh, or the surface of the paper's ``mesh`` stage.
        gaussians: their number on the surface.
        mouth_gaussians: those sampled around the mouth.
        follow_weights: whether each Gaussian has a learned weight between the head's motion and the body's; without
            them all are moved with the head, as in the paper, and the pose deformation MLP holds the torso back.
        super_resolution: factor by which a network enlarges what is drawn: 2, 4 or 8, or 1 for none.
        super_resolution_channels: channels that the head is drawn in for that network, the first three being colours.
        features: learned features of a Gaussian.
        deformation_width: hidden size of the expression deformation MLP and of the pose deformation MLP.
        deformation_layers: hidden layers of the expression deformation MLP; the pose one has two.
        appearance_width: hidden size of the colour and attribute MLPs.
        deformation_scale: bound of a branch's displacement, metres. Without follow weights it must be wide enough for
            the torso to rest while the head turns (0.2).
        attribute_scale: factor on the attribute MLPs' outputs.
        near: up to this distance from the landmarks, metres, a point follows the expression alone.
        far: from this distance, metres, a point follows the pose alone.
    """

    start: Literal["tracked", "mesh"] = "tracked"
    gaussians: int = 20_000
    mouth_gaussians: int = 600
    follow_weights: bool = True
    super_resolution: int = 1
    super_resolution_channels: int = 32
    features: int = 32
    deformation_width: int = 64
    deformation_layers: int = 3
    appearance_width: int = 32
    deformation_scale: float = 0.05
    attribute_scale: float = 0.2
    near: float = 0.03
    far: float = 0.05

    @property
    def colour_channels(self) -> int:
        """Channels that the head is drawn in, the first three being colours."""
        return 3 if self.super_resolution == 1 else self.super_resolution_channels


@dataclass(frozen=True)
class LossWeights:
    """Weights of the joint training's terms (supplement B, in metres).

    The paper has no ``tracking``, ``reach`` and ``settling``, which is of dynamics of strands alone.

    The perceptual term needs a network to be fetched, so only presets that train for longer have it: the paper's 0.1,
    and 0.6 from ``perceptual_raised_from`` on.
    """

    rgb: float = 2.0
    ssim: float = 0.2
    perceptual: float = 0.0
    perceptual_raised: float = 0.0
    segmentation: float = 10.0
    body: float = 5.0
    orientation: float = 1.0
    penetration: float = 100.0
    elastic: float = 50_000.0
    colour_gradient: float = 0.01
    colour_spatial: float = 0.01
    colour_consistency: float = 0.01
    tracking: float = 100.0
    reach: float = 0.0
    settling: float = 0.0


@dataclass(frozen=True)
class LearningRates:
    """Adam's learning rates."""

    deformer: float = 1e-3
    strands: float = 1e-5
    hair_colour: float = 1e-2
    hair_gloss: float = 5e-4
    head_networks: float = 5e-4
    super_resolution: float = 5e-4
    head_colour: float = 5e-3
    head_opacity: float = 1e-3
    head_scales: float = 1e-3
    head_means: float = 1e-5
    head_modes: float = 1e-5
    head_features: float = 1e-3
    head_rotations: float = 1e-3
    head_follow: float = 5e-3
    body_response: float = 1e-4
    scalp_cover: float = 1e-2
    pose_correction: float = 1e-5
    modes: float = 5e-3
    dynamics: float = 3e-4


@dataclass(frozen=True)
class TrainingConfig:
    """The joint training.

    Attributes:
        iterations: steps; a step sees one time step from several views.
        views: views a step.
        cameras: how many of the capture's cameras are used; all if 0.
        static_every: every so many steps the rest frame's static views are seen, where there are any; never if 0.
        image_size: longer side of the training images, pixels; larger captures are reduced.
        precision: of the networks' hidden layers; ``auto`` is decided by measurement when a run begins, and kept.
        seed: of everything random.
        penetration_points: strand points tested against the head in a step, at most.
        reach_points: strand points that the reach term sees in a step; of each view it sees a tenth as many pixels.
        body_collision: whether they are also kept out of neck and shoulders; the paper's see the head alone.
        perceptual_every: every so many steps the perceptual distance is measured, with as much more weight.
        perceptual_crop: side of the random crops that it is measured on, pixels.
        perceptual_raised_from: share of the iterations after which its weight is the raised one.
        colour_neighbours: nearest Gaussians on other strands whose colours are held together.
        bad_steps: how many steps may be skipped, for want of a finite loss and gradient, before the training stops.
        segmentation_warmup: share of the iterations after which the segmentation weight starts to decay.
        segmentation_floor: share of the segmentation weight that stays.
        checkpoint_every: steps between checkpoints.
        preview_every: steps between preview images.
        weights: of the losses.
        rates: of learning.
    """

    iterations: int = 4000
    views: int = 2
    cameras: int = 0
    static_every: int = 8
    image_size: int = 256
    precision: Literal["auto", "float32", "bfloat16"] = "auto"
    seed: int = 0
    penetration_points: int = 2500
    reach_points: int = 3000
    body_collision: bool = True
    perceptual_every: int = 8
    perceptual_crop: int = 96
    perceptual_raised_from: float = 0.75
    colour_neighbours: int = 8
    bad_steps: int = 100
    segmentation_warmup: float = 0.5
    segmentation_floor: float = 0.5
    checkpoint_every: int = 500
    preview_every: int = 500
    weights: LossWeights = field(default_factory=LossWeights)
    rates: LearningRates = field(default_factory=LearningRates)

    def __post_init__(self) -> None:
        may_be_zero = {"cameras", "static_every", "penetration_points", "bad_steps", "seed"}
        for setting in dataclasses.fields(self):
            value, least = getattr(self, setting.name), 0 if setting.name in may_be_zero else 1
            if type(value) is int and value < least:
                raise DynhairError(f"'training.{setting.name}' is {value}", expected=f"{least} or more")


@dataclass(frozen=True)
class Config:
    """Everything that determines an avatar, given a capture."""

    hair: HairConfig = field(default_factory=HairConfig)
    static: StaticConfig = field(default_factory=StaticConfig)
    mesh: MeshHeadConfig = field(default_factory=MeshHeadConfig)
    head: HeadConfig = field(default_factory=HeadConfig)
    training: TrainingConfig = field(default_factory=TrainingConfig)


def with_deformer(config: Config, kind: DeformerKind) -> Config:
    """A configuration with another kind of deformer, which looks as far back as is good for that one.

    The paper's also stretches strands and does not see the head's turn since rest, as in the paper.
    """
    if kind == config.hair.deformer.kind:
        return config
    deformer = dataclasses.replace(
        config.hair.deformer,
        kind=kind,
        history=HISTORIES[kind],
        turn=kind != "paper",
        inextensible=kind != "paper",
    )
    return dataclasses.replace(config, hair=dataclasses.replace(config.hair, deformer=deformer))


def write_config(config: Config, path: Path) -> None:
    """Write a configuration as YAML, atomically."""
    with atomic_file(path) as temporary:
        temporary.write_text(yaml.safe_dump(dataclasses.asdict(config), sort_keys=False), encoding="utf-8")


def read_config(path: Path) -> Config:
    """Read a configuration; what the file leaves out keeps its default.

    Raises:
        DynhairError: the file is missing, is not YAML, or holds an unknown name or a value of the wrong type.
    """
    try:
        value = yaml.safe_load(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise DynhairError("the file is missing", path=path) from None
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise DynhairError(f"not readable as YAML ({error})", path=path) from None
    return _build(Config, value if value is not None else {}, path, "")


def _build(kind: Any, value: Any, path: Path, where: str) -> Any:
    if dataclasses.is_dataclass(kind):
        if not isinstance(value, dict):
            raise DynhairError(
                f"{where.rstrip('.') or 'the file'} is {value!r}", path=path, expected="names with values"
            )
        assert isinstance(kind, type)
        hints = get_type_hints(kind)
        unknown = [str(name) for name in value if name not in hints]
        if unknown:
            raise DynhairError(
                f"unknown setting '{where}{unknown[0]}'", path=path, expected=f"one of {', '.join(hints)}"
            )
        built = {name: _build(hints[name], item, path, f"{where}{name}.") for name, item in value.items()}
        try:
            return kind(**built)
        except DynhairError as error:
            raise DynhairError(error.message, path=path, expected=error.expected) from None
    name = where.rstrip(".")
    if get_origin(kind) is Literal:
        if value not in get_args(kind):
            raise DynhairError(f"'{name}' is {value!r}", path=path, expected=f"one of {', '.join(get_args(kind))}")
        return value
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
        raise DynhairError(f"'{name}' is {value!r}", path=path, expected=f"a {kind.__name__}")
    return value
