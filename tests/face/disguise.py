"""The open head in the vertex order of other models, so that their readers have a face to read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynhair.face import FaceModel, open_head

IDENTITIES = 3
EXPRESSIONS = 2


@dataclass(frozen=True)
class Disguise:
    """Arrays of the open head on a mesh of another size, whose further vertices hang on no face.

    Attributes:
        places: the vertices of the other mesh, in the order of `sources`.
        sources: the open head's vertices there.
    """

    places: np.ndarray
    sources: np.ndarray
    mean: np.ndarray
    identity_modes: np.ndarray
    expression_modes: np.ndarray
    faces: np.ndarray
    head_weight: np.ndarray


def disguise(count: int, landmarks68: tuple[int, ...]) -> Disguise:
    """Put the open head, or as much of it as there is room for, on a mesh whose landmarks are given."""
    head = open_head()
    marks = head.landmarks68.numpy()
    others = np.setdiff1d(np.arange(len(head.mean)), marks)
    if count < len(head.mean):  # the shoulders go first
        others = others[np.argsort(-head.head_weight.numpy()[others], kind="stable")][: count - 68]
    free = np.setdiff1d(np.arange(count), landmarks68)[: len(others)]
    places, sources = np.concatenate([landmarks68, free]), np.concatenate([marks, others])
    place_of = np.full(len(head.mean), -1)
    place_of[sources] = places
    faces = place_of[head.faces.numpy()]

    def spread(values: np.ndarray) -> np.ndarray:
        spread = np.zeros((*values.shape[:-2], count, values.shape[-1]))
        spread[..., places, :] = values[..., sources, :]
        return spread

    return Disguise(
        places=places,
        sources=sources,
        mean=spread(head.mean.double().numpy()),
        identity_modes=spread(head.identity_modes[:IDENTITIES].double().numpy()),
        expression_modes=spread(head.expression_modes[:EXPRESSIONS].double().numpy()),
        faces=faces[(faces >= 0).all(1)],
        head_weight=spread(head.head_weight[:, None].double().numpy())[:, 0],
    )


def assert_sees_through(model: FaceModel, truth: Disguise) -> None:
    """The reader found the open head again: faces outwards, hair where hair grows, and what moves with the head."""
    head = open_head()
    np.testing.assert_allclose(model.mean[model.landmarks68], head.mean[head.landmarks68], atol=1e-5)
    np.testing.assert_allclose(model.mean.numpy(), truth.mean, atol=1e-5)
    np.testing.assert_allclose(model.identity_modes[:IDENTITIES].numpy(), truth.identity_modes, atol=1e-6)
    np.testing.assert_array_equal(model.faces.numpy(), truth.faces)
    kept = np.flatnonzero(np.isin(head.faces.numpy(), truth.sources).all(1))
    true_scalp = np.isin(kept, head.scalp.numpy())
    found = np.zeros(len(kept), dtype=bool)
    found[model.scalp.numpy()] = True
    assert (found & true_scalp).sum() > 0.9 * (found | true_scalp).sum()
    error = np.abs(model.head_weight.numpy() - truth.head_weight)[truth.places]
    assert error.mean() < 0.03
