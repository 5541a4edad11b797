"""Made-up landscapes as a drone or a mast sees them: sky, clouds, ridges, ground, water, roads, fog, glare; no smoke.

What looks like smoke and is none is drawn here: clouds down to the horizon, fog banks in valleys, dust along roads,
lakes, snow, rocks and roofs that shine, the sun's glare. `frames` lays smoke over them.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]

SKIES_BGR = np.array(  # zenith and horizon of clear, hazy, overcast and evening skies
    [
        [[190, 120, 60], [235, 215, 195]],
        [[150, 85, 40], [225, 190, 160]],
        [[225, 180, 140], [240, 232, 225]],
        [[200, 195, 190], [235, 235, 235]],
        [[170, 160, 150], [210, 205, 205]],
        [[140, 120, 110], [190, 205, 225]],
        [[250, 248, 246], [252, 252, 252]],
        [[120, 90, 65], [200, 190, 175]],
    ],
    np.float32,
)
GROUNDS_BGR = np.array(  # forest, fields, dry grass, bush, rock, farmland, bare earth
    [
        [35, 60, 42],
        [45, 85, 60],
        [70, 120, 110],
        [75, 130, 150],
        [55, 75, 75],
        [95, 110, 120],
        [60, 100, 80],
        [85, 115, 140],
    ],
    np.float32,
)


@dataclass(frozen=True, slots=True)
class Landscape:
    """An image (H, W, 3) uint8 BGR and, for each pixel, how near it is: 0 the sky, then ridges from far to near.

    `horizon` (2,) is the row at the left and at the right edge; `haze_bgr` (3,) what distance fades to.
    """

    image: NDArray[np.uint8]
    rank: NDArray[np.uint8]
    horizon: tuple[float, float]
    haze_bgr: NDArray[np.float32]


def draw_landscape(rng: np.random.Generator, width: int = 640, height: int = 360) -> Landscape:
    """One landscape; the same generator state draws the same one."""
    middle = rng.uniform(0.12, 0.72) * height
    tilt = np.tan(np.radians(rng.normal(0.0, 3.0) if rng.random() < 0.65 else rng.uniform(-40.0, 40.0)))
    x = np.arange(width, dtype=np.float32)
    line = (middle + tilt * (x - width / 2.0)).astype(np.float32)
    sky, haze = _sky(rng, line, height)
    image, rank = sky, np.zeros((height, width), np.uint8)
    rows = np.arange(height, dtype=np.float32)[:, None]
    ridges = int(rng.integers(1, 6))
    relief = height * (rng.uniform(0.0, 0.07) if rng.random() < 0.7 else rng.uniform(0.07, 0.22))
    palette = GROUNDS_BGR[rng.choice(len(GROUNDS_BGR), 3)] * rng.uniform(0.55, 1.35)
    haze_depth = rng.uniform(0.35, 3.0)
    steps = np.sort(rng.uniform(0.0, 1.0, ridges)) ** 2
    steps[0] = 0.0
    for number, step in enumerate(steps):
        near = step**0.7
        crest = line + step * 0.55 * height - _profile(rng, width) * relief * (0.4 + 1.6 * near)
        below = np.clip(rows - crest[None, :] + 0.5, 0.0, 1.0)[..., None]
        depth = np.clip((rows - line[None, :]) / (0.6 * height), 0.003, 1.0)
        ground = _ground(rng, depth, palette, far=number == 0)
        # haze by distance on level ground, at least that of the ridge
        veil = np.exp(-haze_depth * 12.0 * np.maximum(depth, step * 0.35))[..., None]
        ground = ground * (1.0 - veil) + haze * veil
        if rng.random() < 0.3:
            ground = _with_fog(rng, ground, crest, haze)
        image = image * (1.0 - below) + ground * below
        rank[below[..., 0] > 0.5] = number + 1
    if rng.random() < 0.35:
        _things(rng, image, line, height)
    if rng.random() < 0.3:
        _foreground(rng, image, rank, ridges + 1)
    if rng.random() < 0.25:
        image = _with_glare(rng, image, line)
    return Landscape(np.clip(image, 0, 255).astype(np.uint8), rank, (float(line[0]), float(line[-1])), haze)


def fractal(
    rng: np.random.Generator, shape: tuple[int, int], cells: float, octaves: int = 5, gain: float = 0.55
) -> Image:
    """Smooth noise (H, W) of about zero mean and unit variance, `cells` bumps across its width."""
    height, width = shape
    total, weight = np.zeros(shape, np.float32), 0.0
    for octave in range(octaves):
        nx = max(2, int(cells * 2**octave) + 1)
        ny = max(2, int(nx * height / width) + 1)
        if nx > width:
            break
        noise = rng.standard_normal((ny, nx), dtype=np.float32)
        total += np.float32(gain**octave) * cv2.resize(noise, (width, height), interpolation=cv2.INTER_CUBIC)
        weight += gain ** (2 * octave)
    return total / np.float32(np.sqrt(weight) * 0.75)


def _sky(rng: np.random.Generator, line: Image, height: int) -> tuple[Image, NDArray[np.float32]]:
    width = line.size
    zenith, horizon = SKIES_BGR[rng.integers(len(SKIES_BGR))] * rng.uniform(0.75, 1.08)
    up = np.clip((line[None, :] - np.arange(height, dtype=np.float32)[:, None]) / height, 0.0, 1.5)
    share = (1.0 - np.exp(-up / rng.uniform(0.08, 0.6)))[..., None]
    sky = horizon * (1.0 - share) + zenith * share
    if rng.random() < 0.6:
        # clouds get flatter and closer towards the horizon
        stretch = rng.uniform(1.0, 5.0)
        noise = fractal(rng, (int(height * stretch), width), rng.uniform(1.5, 6.0))
        source = np.clip(np.log1p(up * rng.uniform(2.0, 12.0)) / np.log(14.0), 0.0, 1.0) * (noise.shape[0] - 1)
        columns = np.tile(np.arange(width, dtype=np.float32), (height, 1))
        noise = cv2.remap(noise, columns, source.astype(np.float32), cv2.INTER_LINEAR)
        cover = np.clip((noise - rng.uniform(-0.6, 1.2)) * rng.uniform(0.5, 3.0), 0.0, 1.0)[..., None]
        cover = cover * rng.uniform(0.4, 1.0)
        shade = 1.0 - 0.25 * np.clip(fractal(rng, (height, width), 6.0), 0.0, 1.5)[..., None] * rng.uniform(0.0, 1.0)
        cloud = np.minimum(zenith.max() + rng.uniform(20.0, 110.0), 253.0) * shade
        sky = sky * (1.0 - cover) + cloud * cover
    if rng.random() < 0.3:  # a bank of cumulus that stands on the horizon
        top = np.clip(_profile(rng, width) * 0.5 + 0.2, 0.0, 1.5) * rng.uniform(0.02, 0.12) * height
        bank = np.clip((top[None, :] - up * height) / rng.uniform(1.0, 8.0), 0.0, 1.0)[..., None]
        bank = bank * rng.uniform(0.3, 1.0)
        sky = sky * (1.0 - bank) + np.minimum(horizon + rng.uniform(-25.0, 40.0), 254.0) * bank
    if rng.random() < 0.25:
        sky = _with_cumulus(rng, sky, line)
    return sky.astype(np.float32), horizon.astype(np.float32) * np.float32(rng.uniform(0.85, 1.0))


def _with_cumulus(rng: np.random.Generator, sky: Image, line: Image) -> Image:
    """Heaps with flat bases and cauliflower tops, from fair-weather puffs to towers."""
    height, width = sky.shape[:2]
    rows = np.arange(height, dtype=np.float32)[:, None]
    columns = np.arange(width, dtype=np.float32)[None, :]
    base = rng.uniform(-0.02, 0.3) * height  # over the horizon
    shade = 0.88 + 0.1 * fractal(rng, (height, width), rng.uniform(8.0, 25.0), 4)
    white = rng.uniform(190.0, 254.0) * (1.0 + rng.normal(0.0, 0.02, 3)).astype(np.float32)
    for _ in range(int(rng.integers(1, 9))):
        x, half = rng.uniform(0.0, width), np.exp(rng.uniform(np.log(8.0), np.log(110.0)))
        tall = half * rng.uniform(0.4, 2.2)
        up = line[None, :] - base - rng.normal(0.0, 2.0) - rows
        bulge = np.sqrt(np.clip(1.0 - np.square((columns - x) / half), 0.0, None))
        ragged = 1.0 + 0.3 * fractal(rng, (height, width), 2.0 * width / half, 4)
        cover = np.clip((tall * bulge * ragged - up) / (0.08 * tall + 1.0), 0.0, 1.0)
        cover = cover * np.clip(up / (0.06 * tall + 1.5), 0.0, 1.0) * rng.uniform(0.5, 1.0)
        light = np.clip(shade * (0.75 + 0.25 * np.clip(up / tall, 0.0, 1.0)), 0.0, 1.05)
        sky = sky * (1.0 - cover[..., None]) + light[..., None] * white * cover[..., None]
    return np.asarray(sky, np.float32)


def _profile(rng: np.random.Generator, width: int) -> Image:
    return fractal(rng, (8, width), rng.uniform(1.0, 5.0), octaves=7, gain=rng.uniform(0.35, 0.55))[0]


def _ground(rng: np.random.Generator, depth: Image, palette: Image, far: bool) -> Image:
    """The ground (H, W, 3): two kinds of cover in patches, texture that gets finer towards the horizon."""
    height, width = depth.shape
    perspective = (np.log(depth) / np.log(0.003)).astype(np.float32)  # 0 at the bottom, 1 at the horizon
    patches = _in_perspective(rng, perspective, rng.uniform(3.0, 12.0), 5)
    kind = np.clip(patches * rng.uniform(0.8, 4.0) + rng.uniform(-0.8, 0.8), 0.0, 1.0)[..., None]
    colour = palette[0] * kind + palette[1] * (1.0 - kind)
    coarse = _in_perspective(rng, perspective, rng.uniform(10.0, 30.0), 4)
    fine = fractal(rng, (height, width), rng.uniform(60.0, 200.0), 3) * np.clip(depth * 6.0, 0.25 if far else 0.5, 1.0)
    light = 1.0 + rng.uniform(0.05, 0.25) * coarse + rng.uniform(0.05, 0.35) * fine
    if rng.random() < 0.25:  # bright spots: rocks, roofs, bare earth, snow
        spots = _in_perspective(rng, perspective, rng.uniform(20.0, 60.0), 3)
        bright = np.clip((spots - rng.uniform(1.4, 2.4)) * 3.0, 0.0, 1.0)[..., None]
        colour = colour * (1.0 - bright) + rng.uniform(120.0, 245.0) * bright
    return (colour * np.clip(light, 0.25, 2.0)[..., None]).astype(np.float32)


def _in_perspective(rng: np.random.Generator, perspective: Image, cells: float, octaves: int) -> Image:
    """Noise whose bumps shrink, and flatten, with distance."""
    width = perspective.shape[1]
    plane = fractal(rng, (512, 512), cells, octaves)
    columns = np.linspace(-1.0, 1.0, width, dtype=np.float32)[None, :]
    x = columns * (1.0 + 6.0 * perspective**2) * 40.0 + 256.0
    y = perspective * np.float32(rng.uniform(500.0, 1500.0)) + np.float32(rng.uniform(0.0, 512.0))
    return cv2.remap(plane, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)


def _with_fog(rng: np.random.Generator, ground: Image, crest: Image, haze: NDArray[np.float32]) -> Image:
    """Flat banks of fog, haze or dust that lie along the ground."""
    height, width = ground.shape[:2]
    rows = np.arange(height, dtype=np.float32)[:, None]
    middle = crest[None, :] + rng.uniform(0.0, 0.25) * height
    flat = np.exp(-np.square((rows - middle) / (height * rng.uniform(0.005, 0.05))))
    noise = cv2.resize(fractal(rng, (24, width), rng.uniform(1.0, 4.0)), (width, height))
    cover = (flat * np.clip(noise + rng.uniform(-0.5, 0.8), 0.0, 1.0) * rng.uniform(0.1, 0.8))[..., None]
    colour = haze * rng.uniform(0.9, 1.1) if rng.random() < 0.75 else np.array([120.0, 160.0, 190.0], np.float32)
    return np.asarray(ground * (1.0 - cover) + colour * cover, np.float32)


def _things(rng: np.random.Generator, image: Image, line: Image, height: int) -> None:
    """Roads, lakes and roofs on the ground, in place."""
    width = line.size
    base = float(line.mean())
    for _ in range(int(rng.integers(1, 5))):
        depth = rng.uniform(0.02, 1.0) ** 1.5
        y = base + depth * (height - base) * 0.95
        x = rng.uniform(0.0, width)
        tone = float(rng.uniform(110.0, 250.0))
        colour = tuple(float(c) for c in tone * rng.uniform(0.92, 1.06, 3))
        match rng.integers(4):
            case 0:
                ends = np.array([[x, y], [x + rng.normal(0, 60), y + depth * rng.uniform(10, 120)]])
                bend = ends.mean(axis=0) + rng.normal(0.0, 30.0, 2) * [1.0, 0.2]
                points = np.array([ends[0], bend, ends[1]]).astype(np.int32)
                cv2.polylines(image, [points], False, colour, max(1, int(depth * 8)), cv2.LINE_AA)
            case 1:  # a runway or a straight road towards the horizon
                far, half = np.array([x, base + 0.5 * depth * (height - base)]), rng.uniform(2.0, 40.0)
                near = np.array([x + rng.normal(0.0, 120.0), height + rng.uniform(0.0, 200.0)])
                across = np.array([half, 0.0])
                edges = [far - 0.1 * across, far + 0.1 * across, near + across, near - across]
                cv2.fillPoly(image, [np.array(edges).astype(np.int32)], colour, cv2.LINE_AA)
                if rng.random() < 0.5:
                    middle = [tuple(int(c) for c in one) for one in (far, near)]
                    cv2.line(image, middle[0], middle[1], (230.0, 230.0, 230.0), 1, cv2.LINE_AA)
            case 2:
                axes = (int(rng.uniform(10.0, 120.0)), max(1, int(rng.uniform(1.0, 18.0) * (0.15 + depth))))
                cv2.ellipse(image, (int(x), int(y)), axes, float(rng.normal(0, 3)), 0, 360, colour, -1, cv2.LINE_AA)
            case _:
                for _ in range(int(rng.integers(2, 25))):
                    at = np.array([x, y]) + rng.normal(0.0, [50.0 * (0.3 + depth), 8.0 * (0.3 + depth)])
                    size = np.maximum(rng.uniform(0.5, 5.0, 2) * (0.3 + depth), 0.6)
                    low, high = (at - size).astype(int), (at + size).astype(int)
                    cv2.rectangle(image, low.tolist(), high.tolist(), colour, -1, cv2.LINE_AA)


def _foreground(rng: np.random.Generator, image: Image, rank: NDArray[np.uint8], number: int) -> None:
    """Trees, a mast or a part of the vehicle before everything, in place."""
    height, width = rank.shape
    mask = np.zeros((height, width), np.uint8)
    for _ in range(int(rng.integers(1, 5))):
        x, top = rng.uniform(0.0, width), rng.uniform(0.1, 0.95) * height
        half = rng.uniform(1.0, 40.0)
        if rng.random() < 0.35:
            cv2.rectangle(mask, (int(x), int(top)), (int(x + half / 8), height), 255, -1)
        else:
            points = np.array([[x, top], [x - half, height], [x + half, height]]) + rng.normal(0, 3, (3, 2))
            cv2.fillPoly(mask, [points.astype(np.int32)], 255)
    ragged = cv2.GaussianBlur(mask.astype(np.float32) / 255.0, (0, 0), 3.0)
    ragged += 0.25 * fractal(rng, (height, width), 60.0, 3)
    inside = (ragged > 0.5) & (cv2.dilate(mask, np.ones((9, 9), np.uint8)) > 0)
    leaves = 1.0 + 0.3 * fractal(rng, (height, width), 90.0, 3)[..., None]
    tone = rng.uniform(10.0, 70.0) * np.array([0.9, 1.15, 1.0]) * leaves
    image[inside] = tone[inside]
    rank[inside] = number


def _with_glare(rng: np.random.Generator, image: Image, line: Image) -> Image:
    height, width = image.shape[:2]
    x, y = rng.uniform(0.0, width), float(line.mean()) - rng.uniform(-0.02, 0.5) * height
    columns, rows = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    distance = np.hypot(columns - x, rows - y) / height
    glow = np.exp(-distance / rng.uniform(0.02, 0.3)) * rng.uniform(60.0, 300.0)
    return np.asarray(image + glow[..., None] * np.array([0.9, 0.97, 1.0], np.float32), np.float32)
