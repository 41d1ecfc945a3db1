"""The networks in torch: the paper's, and a more robust one, both under a millisecond on a CPU.

Both take features (N, C, 64, 64), float32, and give logits (N, classes). The paper says: input
64x64, grayscale together with its Radon reconstruction; two convolutional and two dense layers, two
max-poolings, one output layer. What it leaves open is chosen here:

| open in the paper | choice | reason |
|---|---|---|
| filters | 64, 128 | the usual doubling after each pooling |
| kernels | 7x7 with stride 2, 5x5 | a number that the dense layers read has seen 35 of 64 pixels |
| activation | ReLU | named nowhere, standard with Adam and cross-entropy in its year |
| pooling | 3x3, stride 2 | overlapping, as in AlexNet |
| dense widths | 256, 128 | the first dense layer holds 90 % of the weights |
| dropout | 0.5 before each dense layer | the dense layers memorise pictures otherwise |
"""

from typing import Literal

import torch
from torch import Tensor, nn

Architecture = Literal["paper", "robust"]


def convolution(inputs: int, outputs: int, kernel: int, stride: int = 1) -> list[nn.Module]:
    """Return one of the paper's convolutional layers with its pooling, which halves the map."""
    return [
        nn.Conv2d(inputs, outputs, kernel, stride=stride, padding=kernel // 2),
        nn.ReLU(),
        nn.MaxPool2d(3, 2, padding=1),
    ]


def dense(inputs: int, classes: int, dropout: float) -> list[nn.Module]:
    """Return the paper's two dense layers and its output layer, of a map of `inputs` numbers."""
    return [
        nn.Flatten(),
        nn.Dropout(dropout),
        nn.Linear(inputs, 256),
        nn.ReLU(),
        nn.Dropout(dropout),
        nn.Linear(256, 128),
        nn.ReLU(),
        nn.Linear(128, classes),
    ]


class PaperNet(nn.Module):
    """The paper's network: conv, pool, conv, pool, dense, dense, output."""

    def __init__(self, channels: int = 2, classes: int = 2, size: int = 64, dropout: float = 0.5):
        super().__init__()
        side = (size + 7) // 8
        self.body = nn.Sequential(
            *convolution(channels, 64, kernel=7, stride=2),
            *convolution(64, 128, kernel=5),
            *dense(128 * side**2, classes, dropout),
        )

    def forward(self, features: Tensor) -> Tensor:
        """Return logits (N, classes) of features (N, C, size, size)."""
        logits: Tensor = self.body(features)
        return logits


def _block(inputs: int, outputs: int, stride: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 3, stride=stride, padding=1, bias=False),
        nn.BatchNorm2d(outputs),
        nn.ReLU(inplace=True),
    )


class RobustNet(nn.Module):
    """Six convolutions with batch normalisation; keeps where things stand in the picture.

    Global average pooling would forget at which row the junction lies, and that row is what divides
    *junction* from *none*; so a small dense layer reads the last 4x4 map as it is. It takes half
    the paper's network's time. A road's mirror image is as much of a junction as the road: with
    `mirror_mean` the answer, outside training, is the mean of both, in twice the time.
    """

    def __init__(
        self,
        channels: int = 2,
        classes: int = 2,
        dropout: float = 0.2,
        mirror_mean: bool = False,
    ):
        super().__init__()
        self.mirror_mean = mirror_mean
        self.body = nn.Sequential(
            _block(channels, 24, 2),
            _block(24, 48, 1),
            _block(48, 64, 2),
            _block(64, 96, 2),
            _block(96, 96, 1),
            _block(96, 128, 2),
            nn.Flatten(),
            nn.Dropout(dropout),
            nn.Linear(128 * 16, 96),
            nn.ReLU(),
            nn.Linear(96, classes),
        )

    def forward(self, features: Tensor) -> Tensor:
        """Return logits (N, classes) of features (N, C, 64, 64)."""
        if self.training or not self.mirror_mean:
            logits: Tensor = self.body(features)
            return logits
        plain, mirrored = self.body(torch.cat([features, features.flip(3)])).chunk(2)
        return (plain + mirrored) / 2


class WithMask(nn.Module):
    """A `RobustNet` that also says where road and junction lie: in training only.

    The second output is read from the last 8x8 map, so that the network learns to see where a
    junction's surface is before it learns to judge it. It is not exported.
    """

    def __init__(self, network: RobustNet):
        super().__init__()
        self.network = network
        self.where = nn.Sequential(nn.Conv2d(96, 2 * 4, 1), nn.PixelShuffle(2))

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Return logits (N, classes), and logits (N, 2, 16, 16) of any road and of junctions."""
        deep: Tensor = self.network.body[:5](features)
        logits: Tensor = self.network.body[5:](deep)
        masks: Tensor = self.where(deep)
        return logits, masks


def build(
    architecture: Architecture,
    channels: int = 2,
    classes: int = 2,
    dropout: float | None = None,
    mirror_mean: bool = False,
) -> nn.Module:
    """Return a new network of this architecture, randomly initialised.

    `dropout` None: its own; `mirror_mean` is for `robust` only.
    """
    if architecture == "paper":
        return PaperNet(channels, classes, dropout=0.5 if dropout is None else dropout)
    return RobustNet(channels, classes, 0.2 if dropout is None else dropout, mirror_mean)


def parameters(network: nn.Module) -> int:
    """Return the number of trainable weights."""
    return sum(p.numel() for p in network.parameters() if p.requires_grad)


class WithSoftmax(nn.Module):
    """A network whose output is probabilities: what is exported to ONNX."""

    def __init__(self, network: nn.Module):
        super().__init__()
        self.network = network

    def forward(self, features: Tensor) -> Tensor:
        """Return probabilities (N, classes)."""
        return torch.softmax(self.network(features), dim=1)
