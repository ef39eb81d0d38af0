"""What moves the hair: the head's recent motion in, displacements of the canonical strands out."""

from __future__ import annotations

import itertools
from abc import abstractmethod

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dynhair.avatar.chunked import PointLayer, evaluate_chunked
from dynhair.avatar.encoding import encoded_size, positional_encoding
from dynhair.avatar.mlp import PointNetwork
from dynhair.avatar.splines import evenly_spaced, natural_spline
from dynhair.config import DeformerConfig
from dynhair.motion import signal_names

POSITION_UNIT = 0.15  # metres; canonical positions are encoded in this unit, the size of a head
DISPLACEMENT_UNIT = 0.1  # metres; about one canonical unit of the face models, in which the paper's network predicts


class HairDeformer(PointNetwork):
    """Displacements of strand points from a window of head motion.

    The canonical positions that the network sees are those at construction. They are the points' fixed addresses:
    when the canonical hair is optimised or edited later, a point keeps its motion.

    Args:
        canonical: canonical strands in the head frame, metres.
        config: sizes.
    """

    addresses: Tensor

    def __init__(self, canonical: Float[Tensor, "n l 3"], config: DeformerConfig) -> None:
        super().__init__()
        self.config = config
        self.strands, self.points = canonical.shape[:2]
        self.register_buffer("addresses", canonical.clone())

    def parameters_by_rate(self) -> dict[str, list[nn.Parameter]]:
        """Its parameters under the names of their :class:`~dynhair.config.LearningRates`."""
        return {"deformer": list(self.parameters())}

    @abstractmethod
    def forward(self, window: Float[Tensor, "t c"]) -> Float[Tensor, "n l 3"]:
        """Displacements, metres, in the head frame.

        Args:
            window: normalised conditions of the frames ``t - T .. t``, oldest first.
        """


class PointwiseDeformer(HairDeformer):
    """A network that is evaluated for each point by itself.

    A window becomes an embedding, and the embedding the layers of a small network; this is evaluated for each point, of
    which it sees encoded canonical position and place along the strand. Displacements are attenuated towards the root
    by learnable factors (paper, "Hair deformation network").

    The network can be evaluated at a few knots of each strand, and a natural cubic spline through what it says there
    moves the other points: displacements are smooth along a strand. The attenuation is every point's own.

    Args:
        canonical: canonical strands in the head frame, metres.
        config: sizes.

    Attributes:
        code: what the network sees of each knot, knot by knot: the encoded position, then the place.
        position_features: how much of it is the position.
    """

    code: Tensor
    spline: Tensor

    def __init__(self, canonical: Float[Tensor, "n l 3"], config: DeformerConfig) -> None:
        super().__init__(canonical, config)
        knots = evenly_spaced(self.points, config.knots)
        centred = (canonical[:, knots] - canonical.mean((0, 1))) / POSITION_UNIT
        position = positional_encoding(centred.transpose(0, 1), config.position_frequencies)
        along = knots.to(canonical)[:, None] / self.points
        place = positional_encoding(along, config.place_frequencies)[:, None].expand(-1, self.strands, -1)
        self.position_features = position.shape[-1]
        self.register_buffer("code", torch.cat([position, place], -1).flatten(0, 1), persistent=False)
        self.register_buffer("spline", natural_spline(knots, self.points).to(canonical), persistent=False)
        self.root_attenuation = nn.Parameter(torch.linspace(0.05, 1.0, self.points))

    @abstractmethod
    def embedding(self, window: Float[Tensor, "t c"]) -> Float[Tensor, " e"]:
        """What a window of normalised conditions amounts to."""

    @abstractmethod
    def layers(self, embedding: Float[Tensor, " e"]) -> list[PointLayer]:
        """The network under one embedding, which all points share; it displaces them by `DISPLACEMENT_UNIT`."""

    def forward(self, window: Float[Tensor, "t c"]) -> Float[Tensor, "n l 3"]:
        """As :meth:`HairDeformer.forward`."""
        at_knots = evaluate_chunked(self.code, self.layers(self.embedding(window)), self.dtype)
        attenuated = (DISPLACEMENT_UNIT * self.root_attenuation)[:, None] * self.spline
        return (attenuated @ at_knots.view(self.spline.shape[1], -1)).view(self.points, -1, 3).transpose(0, 1)


class PaperDeformer(PointwiseDeformer):
    """The paper's network (paper, "Hair deformation network").

    An LSTM with learnable initial state embeds the encoded window; the embedding scales and shifts (FiLM) the encoded
    canonical position of each point; together with the encoded place along the strand, an MLP turns it into a
    displacement. The paper's ablations (table 2) put an MLP in the place of the LSTM, or the embedding beside the
    point's features in the place of FiLM.

    Args:
        canonical: canonical strands in the head frame, metres.
        config: sizes.
    """

    def __init__(self, canonical: Float[Tensor, "n l 3"], config: DeformerConfig) -> None:
        super().__init__(canonical, config)
        signal_size = encoded_size(3 * len(signal_names(config)), config.signal_frequencies)
        if config.encoder == "lstm":
            self.lstm = nn.LSTM(signal_size, config.hidden, batch_first=True)
            self.h0 = nn.Parameter(torch.zeros(1, 1, config.hidden))
            self.c0 = nn.Parameter(torch.zeros(1, 1, config.hidden))
        else:  # three layers have about as many weights as the LSTM
            self.window_mlp = nn.Sequential(
                nn.Linear((config.history + 1) * signal_size, config.hidden),
                nn.LeakyReLU(),
                nn.Linear(config.hidden, config.hidden),
                nn.LeakyReLU(),
                nn.Linear(config.hidden, config.hidden),
            )
        if config.film:
            self.film = nn.Linear(config.hidden, 2 * self.position_features)
        features = self.code.shape[-1] + (0 if config.film else config.hidden)
        sizes = (features, *[config.width] * config.layers, 3)
        self.mlp = nn.ModuleList([nn.Linear(a, b) for a, b in itertools.pairwise(sizes)])
        last = self.mlp[-1]
        assert isinstance(last, nn.Linear)
        nn.init.normal_(last.weight, std=1e-4)  # the hair starts at rest
        nn.init.zeros_(last.bias)

    def embedding(self, window: Float[Tensor, "t c"]) -> Float[Tensor, " hidden"]:
        """What the encoder makes of a window of normalised conditions."""
        signals = positional_encoding(window, self.config.signal_frequencies)
        if self.config.encoder == "mlp":
            return self.window_mlp(signals.flatten())
        _, (last, _) = self.lstm(signals[None], (self.h0, self.c0))
        return last[0, 0]

    def layers(self, embedding: Float[Tensor, " hidden"]) -> list[PointLayer]:
        """The MLP, what the embedding does to the points' features folded into its first layer."""
        _, *others = [PointLayer(layer.weight, layer.bias) for layer in self.mlp if isinstance(layer, nn.Linear)]
        return [self._first_layer(embedding), *others]

    def _first_layer(self, embedding: Float[Tensor, " hidden"]) -> PointLayer:
        """The first layer under one embedding, which all points share: it folds into weights and bias."""
        first = self.mlp[0]
        assert isinstance(first, nn.Linear)
        if not self.config.film:
            on_points, on_embedding = first.weight.split([self.code.shape[-1], len(embedding)], dim=1)
            return PointLayer(on_points, first.bias + on_embedding @ embedding)
        # FiLM acts on this layer's input alone: W (f (1 + s) + b) = (W (1 + s)) f + W b.
        scale, shift = self.film(embedding).chunk(2)
        on_position, on_place = first.weight.split([len(scale), self.code.shape[-1] - len(scale)], dim=1)
        modulated = torch.cat([on_position * (1 + scale), on_place], dim=1)
        return PointLayer(modulated, first.bias + on_position @ shift)
