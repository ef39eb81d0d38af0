"""The ablations of the paper's Table 2 and Table 4, each a change of a configuration that leaves the rest as it is."""

from __future__ import annotations

import dataclasses
from typing import Any, Literal, get_args

from dynhair.config import Config, with_deformer

AblationName = Literal[
    "paper-deformer",
    "modal-deformer",
    "untaught",
    "pose",
    "no-acceleration",
    "no-gravity",
    "no-turn",
    "no-elastic",
    "stretching",
    "no-film",
    "mlp-encoder",
    "no-colour-terms",
    "no-raised-perceptual",
    "one-view",
    "rigid",
    "head-collision",
    "no-reach",
]
"""``paper-deformer`` has the paper's network, and strands that stretch, and ``modal-deformer`` modes, in the place of
dynamics of strands, which know nothing from simulated hair if they are ``untaught``; ``pose``, ``no-film`` and ``mlp-
encoder`` are of parts of the paper's network, which the others have not. With ``no-turn`` these do not see how the head
has turned since rest, which the paper's network never sees. ``stretching`` lets strands stretch that otherwise
keep their lengths, held back by the elastic term as the paper's are; ``no-elastic`` leaves that term out where there is
one. ``pose`` gives the deformer the head's pose for its velocities, ``rigid`` takes away the non-rigid deformation, and
``head-collision`` keeps strands out of the head alone, as the paper does. ``no-reach`` leaves out a term that the paper
does not have."""

ABLATIONS: tuple[AblationName, ...] = get_args(AblationName)


def ablated(config: Config, name: AblationName | None) -> Config:
    """A configuration without one part of the method; as it is for None."""
    match name:
        case None:
            return config
        case "paper-deformer":
            return with_deformer(config, "paper")
        case "modal-deformer":
            return with_deformer(config, "modal")
        case "untaught" if config.hair.deformer.kind != "strands":
            return config
        case "untaught":
            return _with_deformer(config, taught=False)
        case "pose" | "no-film" | "mlp-encoder" if config.hair.deformer.kind != "paper":
            return config
        case "pose":
            return _with_deformer(config, signals="pose")
        case "no-acceleration":
            return _with_deformer(config, acceleration=False)
        case "no-gravity":
            return _with_deformer(config, gravity=False)
        case "no-turn":
            return _with_deformer(config, turn=False)
        case "stretching":
            return _with_deformer(config, inextensible=False)
        case "no-elastic" if config.hair.deformer.inextensible:
            return config
        case "no-elastic":
            return _with_weights(config, elastic=0.0)
        case "no-film":
            return _with_deformer(config, film=False)
        case "mlp-encoder":
            return _with_deformer(config, encoder="mlp")
        case "no-colour-terms":
            return _with_weights(config, colour_gradient=0.0, colour_spatial=0.0, colour_consistency=0.0)
        case "no-raised-perceptual":
            return _with_weights(config, perceptual_raised=config.training.weights.perceptual)
        case "one-view":
            return _with_training(config, cameras=1, views=1, static_every=0)
        case "rigid":
            return dataclasses.replace(config, hair=dataclasses.replace(config.hair, dynamic=False))
        case "head-collision":
            return _with_training(config, body_collision=False)
        case "no-reach":
            return _with_weights(config, reach=0.0)


def _with_deformer(config: Config, **changes: Any) -> Config:
    deformer = dataclasses.replace(config.hair.deformer, **changes)
    return dataclasses.replace(config, hair=dataclasses.replace(config.hair, deformer=deformer))


def _with_weights(config: Config, **changes: float) -> Config:
    return _with_training(config, weights=dataclasses.replace(config.training.weights, **changes))


def _with_training(config: Config, **changes: Any) -> Config:
    return dataclasses.replace(config, training=dataclasses.replace(config.training, **changes))
