"""The networks that the paper's Table IV compares with, for 64x64 inputs; none is pretrained.

Each takes features (N, C, 64, 64), float32, and gives logits (N, classes). AlexNet and VGG were
made for 224x224: here their first strides are smaller, so that as much of the picture is left for
the later layers as there, and their dense layers are narrower, as is the picture.
"""

from torch import Tensor, nn

from juncnet.network import convolution, dense

VGG_PLAN = (32, 0, 64, 0, 128, 128, 0, 256, 256, 0, 256, 256, 0)
"""Filters of VGG-11's eight convolutions, halved; 0: pooling."""


class OneConvNet(nn.Module):
    """The paper's *1-CNN, 2-FCN*: JuncNet without its second convolution and pooling."""

    def __init__(self, channels: int, classes: int, dropout: float) -> None:
        super().__init__()
        self.body = nn.Sequential(
            *convolution(channels, 64, kernel=7, stride=2), *dense(64 * 16**2, classes, dropout)
        )

    def forward(self, features: Tensor) -> Tensor:
        """Return logits (N, classes)."""
        logits: Tensor = self.body(features)
        return logits


class AlexNet(nn.Module):
    """Krizhevsky et al., 2012: five convolutions, overlapping pooling, two dense layers."""

    def __init__(self, channels: int, classes: int, dropout: float) -> None:
        super().__init__()
        self.body = nn.Sequential(
            nn.Conv2d(channels, 64, 7, stride=2, padding=3),
            nn.ReLU(),
            nn.MaxPool2d(3, 2),
            nn.Conv2d(64, 192, 5, padding=2),
            nn.ReLU(),
            nn.MaxPool2d(3, 2),
            nn.Conv2d(192, 384, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(384, 256, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(256, 256, 3, padding=1),
            nn.ReLU(),
            nn.MaxPool2d(3, 2),
            nn.Flatten(),
            nn.Dropout(dropout),
            nn.Linear(256 * 3 * 3, 1024),
            nn.ReLU(),
            nn.Dropout(dropout),
            nn.Linear(1024, 512),
            nn.ReLU(),
            nn.Linear(512, classes),
        )

    def forward(self, features: Tensor) -> Tensor:
        """Return logits (N, classes)."""
        logits: Tensor = self.body(features)
        return logits


class Vgg(nn.Module):
    """Simonyan and Zisserman, 2014: VGG-11 with batch normalisation, half as many filters."""

    def __init__(self, channels: int, classes: int, dropout: float) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for filters in VGG_PLAN:
            if not filters:
                layers.append(nn.MaxPool2d(2))
                continue
            layers += [
                nn.Conv2d(channels, filters, 3, padding=1, bias=False),
                nn.BatchNorm2d(filters),
                nn.ReLU(),
            ]
            channels = filters
        self.body = nn.Sequential(
            *layers,
            nn.Flatten(),
            nn.Dropout(dropout),
            nn.Linear(256 * 2 * 2, 512),
            nn.ReLU(),
            nn.Dropout(dropout),
            nn.Linear(512, classes),
        )

    def forward(self, features: Tensor) -> Tensor:
        """Return logits (N, classes)."""
        logits: Tensor = self.body(features)
        return logits
