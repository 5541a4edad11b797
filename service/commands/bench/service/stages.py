"""The stages beside the filter: a mask's detections, the pose of a frame, framing and decoding, segmenters."""

from collections.abc import Callable
from functools import partial

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from distloc.sights.detections import detections_from_mask
from distloc.simulation.renderer import Renderer
from distloc.types import CameraPose
from service.autopilot.autopilot import Autopilot
from service.commands.bench.fixed_work import BytesWork, ImageWork
from service.commands.bench.smoke_scene import camera_of, half_mask, plumes_mask, specks_mask
from service.commands.bench.timing import Figure, figure, in_turns, median_ms
from service.common.messages import Frame
from service.config.sections import MavlinkConfig, SegmenterConfig
from service.mavlink.framer import Decoder, Framer
from service.segmenters.segment import Segmenter, make_segmenter
from service.simulator.scenario import camera_pose, load_scenario, plumes
from service.simulator.simulated_autopilot import SimulatedAutopilot

OTHER_SIZES = ((1280, 720), (640, 352))  # than full HD
_FLIGHT_S = 10.0  # of telemetry
_TICK_S = 0.01


class MaskCost(msgspec.Struct, frozen=True):
    """`detections_from_mask`; the ratio is to fixed work on a full HD image."""

    mask: str
    width: int
    height: int
    positive_share: float
    detections: int
    time: Figure


class SegmenterCost(msgspec.Struct, frozen=True):
    """One frame of the demo's scenario; the ratio is to fixed work on a full HD image."""

    segmenter: str
    width: int
    height: int
    time: Figure


class MessageCost(msgspec.Struct, frozen=True):
    """Framing and decoding a flight's telemetry, one datagram at a time; the ratio of a round is to fixed byte work."""

    messages: int
    us_per_message: float
    messages_per_s: float
    round: Figure


class Stages(msgspec.Struct, frozen=True):
    """`pose_lookup` is of `Autopilot.camera_pose`, 100 of them; its ratio is to the same fixed byte work."""

    masks: tuple[MaskCost, ...]
    segmenters: tuple[SegmenterCost, ...]
    framer_and_decoder: MessageCost
    pose_us: float
    hundred_poses: Figure
    fixed_image_work_ms: float
    fixed_bytes_work_ms: float


def measure_stages(rounds: int = 50, segmenter_rounds: int = 7, on_step: Callable[[], None] = lambda: None) -> Stages:
    """All of them; each part's contenders take turns."""
    image_ms, masks = _masks(rounds)
    on_step()
    segmenters = _segmenters(segmenter_rounds, image_ms)
    on_step()
    datagrams, autopilot, end_ns = telemetry(_FLIGHT_S)
    messages = sum(len(Framer().feed(data)) for data in datagrams)
    works: dict[str, Callable[[], object]] = {
        "fixed": BytesWork(),
        "messages": partial(decode_all, datagrams),
        "poses": lambda: [autopilot.camera_pose(end_ns - (index + 10) * 9_000_000, end_ns) for index in range(100)],
    }
    times_s = in_turns(works, rounds)
    on_step()
    bytes_ms = median_ms(times_s["fixed"])
    decoding, poses = figure(times_s["messages"], bytes_ms), figure(times_s["poses"], bytes_ms)
    return Stages(
        masks=masks,
        segmenters=segmenters,
        framer_and_decoder=MessageCost(
            messages=messages,
            us_per_message=round(decoding.median_ms / messages * 1e3, 3),
            messages_per_s=round(messages / decoding.median_ms * 1e3),
            round=decoding,
        ),
        pose_us=round(poses.median_ms * 10.0, 2),
        hundred_poses=poses,
        fixed_image_work_ms=image_ms,
        fixed_bytes_work_ms=bytes_ms,
    )


def telemetry(duration_s: float) -> tuple[list[bytes], Autopilot, int]:
    """A simulated flight's datagrams, the autopilot that took them by its own clock, and when it had all."""
    scenario = load_scenario("demo")
    sender = SimulatedAutopilot(scenario, np.random.default_rng(0))
    autopilot, framer = Autopilot(MavlinkConfig(), scenario.camera.mount), Framer()
    datagrams: list[bytes] = []
    waiting: list[tuple[float, bytes]] = []
    for tick in range(round(duration_s / _TICK_S)):
        t_s = (tick + 1) * _TICK_S
        waiting += sender.due(t_s)
        arrived, waiting = [one for one in waiting if one[0] <= t_s], [one for one in waiting if one[0] > t_s]
        for arrival_s, data in arrived:
            datagrams.append(data)
            for frame in framer.feed(data):
                autopilot.receive(frame, round(arrival_s * 1e9))
        for data in autopilot.due(round(t_s * 1e9)):
            sender.receive(data, t_s)
    end_ns = round(duration_s * 1e9)
    if not isinstance(autopilot.camera_pose(end_ns - 100_000_000, end_ns), CameraPose):
        raise RuntimeError("the simulated autopilot gave no pose: the bench measures nothing")
    return datagrams, autopilot, end_ns


def decode_all(datagrams: list[bytes]) -> None:
    """Frame and decode, as the service does with what a UDP link hears."""
    framer, decoder = Framer(), Decoder()
    for data in datagrams:
        for frame in framer.feed(data):
            decoder.decode(frame)


def masks(width: int = 1920, height: int = 1080) -> dict[str, NDArray[np.uint8]]:
    """The kinds of masks that a service meets, by name."""
    return {
        "empty": np.zeros((height, width), np.uint8),
        "one plume": plumes_mask(width, height, 1),
        "four plumes": plumes_mask(width, height),
        "2000 specks": specks_mask(width, height),
        "half filled": half_mask(width, height),
    }


def _masks(rounds: int) -> tuple[float, tuple[MaskCost, ...]]:
    tried = [*masks().items(), *(("four plumes", plumes_mask(*size)) for size in OTHER_SIZES)]
    works: dict[str, Callable[[], object]] = {"fixed": ImageWork()}
    for index, (_, mask) in enumerate(tried):
        works[str(index)] = partial(detections_from_mask, mask, camera_of(mask.shape[1], mask.shape[0]))
    times_s = in_turns(works, rounds)
    unit_ms = median_ms(times_s["fixed"])
    return unit_ms, tuple(
        MaskCost(
            mask=name,
            width=mask.shape[1],
            height=mask.shape[0],
            positive_share=round(cv2.countNonZero(mask) / mask.size, 4),
            detections=len(detections_from_mask(mask, camera_of(mask.shape[1], mask.shape[0]))),
            time=figure(times_s[str(index)], unit_ms),
        )
        for index, (name, mask) in enumerate(tried)
    )


def _segmenters(rounds: int, unit_ms: float) -> tuple[SegmenterCost, ...]:
    scenario = load_scenario("demo")
    camera = scenario.camera.camera()
    pose = camera_pose(scenario, 0.0, 0.0)
    frame = Frame(0, "bench", Renderer(camera, plumes(scenario), np.random.default_rng(0)).render(pose)[0])
    made: list[Segmenter] = [make_segmenter(SegmenterConfig(kind=kind), camera) for kind in ("classical", "onnx")]
    times_s = in_turns({one.name: partial(one.segment, frame, pose) for one in made}, rounds)
    return tuple(
        SegmenterCost(name, camera.width, camera.height, figure(times, unit_ms)) for name, times in times_s.items()
    )
