"""The network: a U-Net of plain 3 x 3 convolutions, 0.96 million parameters, scores at half of the input's size."""

import torch
from torch import Tensor, nn
from torch.nn import functional


class SmokeNet(nn.Module):
    """RGB (N, 3, H, W) from 0 to 1, H and W multiples of 32, to logits of smoke (N, 1, H / 2, W / 2)."""

    def __init__(self) -> None:
        super().__init__()
        self.at2 = _layer(3, 13, stride=2)
        self.at4 = nn.Sequential(_layer(16, 32, stride=2), _Residual(32))
        self.at8 = nn.Sequential(_layer(32, 64, stride=2), _Residual(64))
        self.at16 = nn.Sequential(_layer(64, 80, stride=2), _Residual(80), _Residual(80))
        self.at32 = nn.Sequential(_layer(80, 96, stride=2), _Residual(96), _Residual(96, dilation=2))
        self.up16, self.up8 = _Up(96, 80, 64), _Up(64, 64, 48)
        self.up4, self.up2 = _Up(48, 32, 32), _Up(32, 16, 16)
        self.head = nn.Conv2d(16, 1, 1)
        nn.init.constant_(self.head.bias, -3.0)  # smoke is rare: what is learnt first is where it may be

    def forward(self, image: Tensor) -> Tensor:
        half = torch.cat([self.at2((image - 0.45) / 0.25), _veil(image)], dim=1)
        quarter = self.at4(half)
        eighth = self.at8(quarter)
        sixteenth = self.at16(eighth)
        up = self.up16(self.at32(sixteenth), sixteenth)
        return self.head(self.up2(self.up4(self.up8(up, eighth), quarter), half))


def _veil(image: Tensor) -> Tensor:
    """What smoke does to colours and texture (N, 3, H / 2, W / 2), so that it need not be learnt.

    It lifts the darkest channel (He et al. 2011): that channel without bright texture, the same against what lies
    left and right of it, and the texture that is left.
    """
    darkest = functional.avg_pool2d(image.min(dim=1, keepdim=True).values, 2)
    eroded = -functional.max_pool2d(-darkest, 5, 1, 2)
    opened = functional.max_pool2d(eroded, 5, 1, 2)
    beside = functional.avg_pool2d(opened, (1, 65), 1, (0, 32), count_include_pad=False)
    mean = functional.avg_pool2d(darkest, 5, 1, 2, count_include_pad=False)
    square = functional.avg_pool2d(darkest * darkest, 5, 1, 2, count_include_pad=False)
    texture = torch.sqrt((square - mean * mean).clamp(min=0.0) + 1e-5)
    return torch.cat([(opened - 0.35) / 0.25, (opened - beside) / 0.08, (texture - 0.04) / 0.04], dim=1)


class _Residual(nn.Module):
    def __init__(self, channels: int, dilation: int = 1) -> None:
        super().__init__()
        self.body = nn.Sequential(
            _layer(channels, channels, dilation=dilation),
            nn.Conv2d(channels, channels, 3, padding=1, bias=False),
            nn.BatchNorm2d(channels),
        )

    def forward(self, x: Tensor) -> Tensor:
        return functional.relu(x + self.body(x))


class _Up(nn.Module):
    """Twice the size, joined with what the way down had there."""

    def __init__(self, below: int, beside: int, channels: int) -> None:
        super().__init__()
        self.narrow = nn.Conv2d(below, channels, 1)
        self.join = _layer(channels + beside, channels)

    def forward(self, x: Tensor, beside: Tensor) -> Tensor:
        wide = functional.interpolate(self.narrow(x), scale_factor=2.0, mode="bilinear", align_corners=False)
        return self.join(torch.cat([wide, beside], dim=1))


def _layer(inputs: int, outputs: int, stride: int = 1, dilation: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, 3, stride, padding=dilation, dilation=dilation, bias=False),
        nn.BatchNorm2d(outputs),
        nn.ReLU(inplace=True),
    )
