"""Deformers over whole motions at once: the same figures as frame by frame, in a fraction of the time."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from dynhair.avatar import ModalDeformer, PaperDeformer
from dynhair.avatar.deformer import DISPLACEMENT_UNIT
from dynhair.avatar.encoding import positional_encoding


def modal_amplitudes(deformer: ModalDeformer, conditions: Float[Tensor, "m f c"]) -> Float[Tensor, "m f r"]:
    """Where the modes are in every frame of motions that begin at rest.

    Args:
        deformer: whose window is not shorter than the motions.
        conditions: normalised, of motions of equal length.
    """
    first, second = conditions[..., deformer.get_buffer("pairs")].unbind(2)
    forces = deformer.forces(torch.cat([conditions, first * second], -1))
    frames = forces.shape[1]
    since = torch.arange(frames)[:, None] - torch.arange(1, frames)[None] + 1
    responses = deformer.oscillators.step_responses(since.clamp_min(0).flatten().to(forces))
    responses = responses.view(frames, frames - 1, -1) * (since > 0)[..., None]
    return forces[:, :1] + torch.einsum("fsr,msr->mfr", responses, forces.diff(dim=1))


def modal_shapes(deformer: ModalDeformer) -> Float[Tensor, "n k 3 r"]:
    """By how much each mode displaces each point, metres."""
    hidden = deformer.code
    for layer in deformer.mlp:
        hidden = functional.leaky_relu(layer(hidden))
    shapes = deformer.shapes(hidden).view(deformer.spline.shape[1], deformer.strands, 3, -1)
    along = DISPLACEMENT_UNIT * deformer.root_attenuation[:, None] * deformer.spline
    return torch.einsum("lk,kncr->nlcr", along, shapes)


def paper_batch(deformer: PaperDeformer, windows: Float[Tensor, "b t c"]) -> Float[Tensor, "b n k 3"]:
    """The paper's network over many windows: its LSTM hears them side by side."""
    count = len(windows)
    signals = positional_encoding(windows, deformer.config.signal_frequencies)
    state = (deformer.h0.expand(-1, count, -1).contiguous(), deformer.c0.expand(-1, count, -1).contiguous())
    embeddings = deformer.lstm(signals, state)[1][0][0]
    scale, shift = deformer.film(embeddings)[:, None].chunk(2, -1)
    position, place = deformer.code.split([scale.shape[-1], deformer.code.shape[-1] - scale.shape[-1]], -1)
    values = torch.cat([position * (1 + scale) + shift, place.expand(count, -1, -1)], -1)
    for index, layer in enumerate(deformer.mlp):
        values = layer(functional.leaky_relu(values) if index else values)
    at_knots = values.view(count, deformer.spline.shape[1], -1, 3)
    along = DISPLACEMENT_UNIT * deformer.root_attenuation[:, None] * deformer.spline
    return torch.einsum("lk,bknc->bnlc", along, at_knots)


def turned(turns: Float[Tensor, "*b n k 3"], canonical: Float[Tensor, "*#b n k 3"]) -> Float[Tensor, "*b n k 3"]:
    """Displacements of strands whose segments turn, by a rotation vector at each one's lower end, and keep lengths."""
    segments = canonical.diff(dim=-2)
    vectors = turns[..., 1:, :]
    angle = vectors.norm(dim=-1, keepdim=True)
    across = torch.linalg.cross(vectors, segments.expand_as(vectors))
    again = torch.linalg.cross(vectors, across)
    # Rodrigues' formula by sinc functions: smooth where nothing turns
    moved = torch.sinc(angle / torch.pi) * across + 0.5 * torch.sinc(angle / (2 * torch.pi)) ** 2 * again
    return functional.pad(moved.cumsum(-2), (0, 0, 1, 0))
