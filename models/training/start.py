"""A model that was released, read back into the network to be fitted further."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from network import SmokeNet

_SIZE = (480, 352)
_FOLDED = "onnx::Conv_"  # how the exporter names a convolution with its batch norm in it: the kernel's, then the bias'


def started(path: Path, images: Sequence[NDArray[np.uint8]]) -> SmokeNet:
    """The network of a file that `export_onnx` wrote, with the same logits.

    The file's convolutions hold their batch norms; the new ones take the mean and the variance of what they see of the
    images (H, W, 3) BGR. ValueError for a file of another network.
    """
    values = {one.name: onnx.numpy_helper.to_array(one) for one in onnx.load(str(path)).graph.initializer}
    net = SmokeNet().eval()
    norms, folded = list(_norms(net)), list(_folded(values))
    shapes = [tuple(conv.weight.shape) for conv, _ in norms]
    if shapes != [kernel.shape for kernel, _ in folded]:
        raise ValueError(f"{path} must be a model of this network, with convolutions of {shapes}")
    with torch.no_grad():
        for (conv, norm), (kernel, bias) in zip(norms, folded, strict=True):
            conv.weight.copy_(torch.tensor(kernel))
            norm.weight.fill_(float(np.sqrt(1.0 + norm.eps)))
            norm.bias.copy_(torch.tensor(bias))
        for name, own in net.named_parameters():
            if name in values:
                own.copy_(torch.tensor(values[name]))
        _settle(net, [norm for _, norm in norms], _batch(images))
    return net


def _norms(net: SmokeNet) -> Iterator[tuple[nn.Conv2d, nn.BatchNorm2d]]:
    """Each convolution that has a batch norm, with it, as the data go."""
    for one, other in pairwise(net.modules()):
        if isinstance(one, nn.Conv2d) and isinstance(other, nn.BatchNorm2d):
            yield one, other


def _folded(values: dict[str, NDArray[np.float32]]) -> Iterator[tuple[NDArray[np.float32], NDArray[np.float32]]]:
    """Kernels and biases as the data go, `split_joins` undone."""
    numbers = sorted({int(name.removeprefix(_FOLDED).split("_")[0]) for name in values if name.startswith(_FOLDED)})
    for kernel, bias in zip(numbers[::2], numbers[1::2], strict=True):
        parts = [name for name in (f"{_FOLDED}{kernel}", f"{_FOLDED}{kernel}_0", f"{_FOLDED}{kernel}_1")]
        yield np.concatenate([values[name] for name in parts if name in values], axis=1), values[f"{_FOLDED}{bias}"]


def _batch(images: Sequence[NDArray[np.uint8]]) -> Tensor:
    rgb = np.stack([cv2.resize(image, _SIZE)[..., ::-1] for image in images])
    return torch.tensor(rgb.copy()).permute(0, 3, 1, 2).float() / 255.0


def _settle(net: SmokeNet, norms: Sequence[nn.BatchNorm2d], images: Tensor) -> None:
    """Each norm divides by what it sees and multiplies by it again."""

    def settle(norm: nn.Module, inputs: tuple[Tensor, ...]) -> None:
        assert isinstance(norm, nn.BatchNorm2d) and norm.running_mean is not None and norm.running_var is not None
        mean, variance = inputs[0].mean((0, 2, 3)), inputs[0].var((0, 2, 3), unbiased=False)
        norm.running_mean.copy_(mean)
        norm.running_var.copy_(variance)
        norm.weight.copy_(torch.sqrt(variance + norm.eps))
        norm.bias.add_(mean)

    hooks = [norm.register_forward_pre_hook(settle) for norm in norms]
    net(images)
    for hook in hooks:
        hook.remove()
