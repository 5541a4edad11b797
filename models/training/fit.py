"""Fitting the network to a stream of frames, the same for the same seed and number of threads."""

import copy
import random
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn import functional
from torch.utils.data import DataLoader, Dataset

from frames import EITHER, NOT_SMOKE, SMOKE, Background, draw_frame
from landscapes import draw_landscape
from network import SmokeNet
from plumes import PlumeCanvas, draw_plume

BATCH = 16
_EMA = 0.99  # the weights that are kept follow those that are fitted
_SMOKE_WEIGHT = 2.0  # of a pixel of smoke against one of anything else
_HARD_SHARE, _HARD_WEIGHT = 0.005, 0.3  # of a frame's pixels without smoke: those most taken for smoke


@dataclass(frozen=True, slots=True)
class Material:
    """What frames are made of: made-up landscapes and plumes; real backgrounds by event, and smoke cut from them.

    `real_share` of frames are real, of an event as many as the square root of its frames: those of one are alike.
    `cut_share` of plumes were cut out.
    """

    landscapes: Sequence[Background]
    plumes: Sequence[PlumeCanvas]
    real: Sequence[Sequence[Background]] = ()
    cut_outs: Sequence[PlumeCanvas] = ()
    real_share: float = 0.0
    cut_share: float = 0.0


def draw_material(seed: int, landscapes: int, plumes: int, jobs: int) -> Material:
    """Made-up material, drawn in `jobs` processes; it does not depend on their number."""
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        grounds = list(pool.map(_landscape, [(seed, 1, i) for i in range(landscapes)], chunksize=4))
        smoke = list(pool.map(_plume, [(seed, 2, i) for i in range(plumes)], chunksize=16))
    return Material(grounds, smoke)


def fit(
    net: SmokeNet,
    material: Material,
    seed: int,
    steps: int,
    rate: float,
    device: str,
    batch: int = BATCH,
    workers: int = 1,
    on_step: Callable[[int, float], None] = lambda step, loss: None,
) -> SmokeNet:
    """The network after `steps` batches, averaged over the last of them; `net` itself is changed too."""
    random.seed(seed)
    torch.manual_seed(seed)
    net.to(device, memory_format=torch.channels_last).train()
    kept = copy.deepcopy(net)
    optimiser = torch.optim.AdamW(net.parameters(), lr=rate, weight_decay=1e-3)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, max_lr=rate, total_steps=steps, pct_start=0.08)
    stream = _Stream(material, seed, steps * batch)
    # forked, not spawned: the material, a gigabyte, is not copied
    loader = DataLoader(stream, batch, num_workers=workers, prefetch_factor=4, multiprocessing_context="fork")
    for step, (images, labels) in enumerate(loader):
        rgb = (images.to(device).permute(0, 3, 1, 2).float().flip(1) / 255.0).contiguous(
            memory_format=torch.channels_last
        )
        with torch.autocast(device, torch.bfloat16):  # twice as fast, also where there is no GPU
            logits = net(rgb)
        loss = _loss(logits.float(), labels.to(device))
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(net.parameters(), 5.0)
        optimiser.step()
        schedule.step()
        _follow(kept, net, min(_EMA, (step + 1) / (step + 10)))
        on_step(step, float(loss.detach()))
    return kept.eval()


class _Stream(Dataset):  # type: ignore[type-arg]
    """Frame `index` depends on the seed and the index alone."""

    def __init__(self, material: Material, seed: int, count: int) -> None:
        self._material, self._seed, self._count = material, seed, count
        frames = np.sqrt([len(event) for event in material.real])
        self._event_share = frames / max(frames.sum(), 1.0)

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        cv2.setNumThreads(1)
        rng = np.random.default_rng([self._seed, 3, index])
        material = self._material
        choices = material.landscapes
        if rng.random() < material.real_share:
            choices = material.real[rng.choice(len(material.real), p=self._event_share)]
        plumes = material.cut_outs if rng.random() < material.cut_share else material.plumes
        return draw_frame(rng, choices[rng.integers(len(choices))], plumes)


def _loss(logits: torch.Tensor, labels: torch.Tensor) -> torch.Tensor:
    """Cross-entropy of the pixels that anyone can tell, once more of the worst false ones, and Dice's of each frame."""
    logits = functional.interpolate(logits, scale_factor=2.0, mode="bilinear", align_corners=False)[:, 0]
    smoke, known = (labels == SMOKE).float(), (labels != EITHER).float()
    weight = known * (1.0 + (_SMOKE_WEIGHT - 1.0) * smoke)
    each = functional.binary_cross_entropy_with_logits(logits, smoke, reduction="none")
    entropy = (each * weight).sum() / weight.sum()
    clear = (each * (labels == NOT_SMOKE)).flatten(1)
    hard = clear.topk(round(_HARD_SHARE * clear.shape[1]), dim=1).values.mean()
    probability = torch.sigmoid(logits) * known
    both, all_ = (probability * smoke).sum((1, 2)), (probability + smoke).sum((1, 2))
    has_smoke = (smoke.sum((1, 2)) > 20).float()
    dice = 1.0 - (2.0 * both + 10.0) / (all_ + 10.0)
    return entropy * 4.0 + hard * _HARD_WEIGHT + (dice * has_smoke).sum() / has_smoke.sum().clamp(min=1.0)


@torch.no_grad()
def _follow(kept: SmokeNet, net: SmokeNet, share: float) -> None:
    for mine, its in zip(kept.state_dict().values(), net.state_dict().values(), strict=True):
        if mine.dtype.is_floating_point:
            mine.mul_(share).add_(its, alpha=1.0 - share)
        else:
            mine.copy_(its)


def _landscape(seed: tuple[int, int, int]) -> Background:
    cv2.setNumThreads(1)
    one = draw_landscape(np.random.default_rng(seed))
    return Background(one.image, np.zeros(one.rank.shape, np.uint8), one.rank, one.horizon, one.haze_bgr)


def _plume(seed: tuple[int, int, int]) -> PlumeCanvas:
    cv2.setNumThreads(1)
    return draw_plume(np.random.default_rng(seed))
