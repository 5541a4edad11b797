"""Our bytes through a parser that is not pymavlink's: MAVSDK's, over UDP on the loopback."""

import asyncio
import json
import math
import socket
from typing import Any

import pytest
from mavsdk.asyncio import Configuration, Mavsdk
from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync
from mavsdk.component_type import ComponentType
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from distloc.geometry.camera import Camera
from service.publish.mavlink import MavlinkPublisher
from tests.support.places import HANG_S
from tests.support.ports import free_port
from tests.support.wire_samples import located, vehicle

WANTED = {
    "HEARTBEAT",
    "STATUSTEXT",
    "DEBUG_FLOAT_ARRAY",
    "NAMED_VALUE_FLOAT",
    "CAMERA_TRACKING_GEO_STATUS",
    "CAMERA_TRACKING_IMAGE_STATUS",
    "CAMERA_FOV_STATUS",
    "CAMERA_INFORMATION",
    "COMMAND_ACK",
    "ADSB_VEHICLE",
}
REPEAT_S = 0.2
NAN_AS_NULL = {"vel_n", "vel_e", "vel_d", "vel_acc", "hdg_acc"}


def everything(publisher: MavlinkPublisher, now_ns: int, ground: tuple[int, int]) -> list[bytes]:
    """All that we send; `ground` asks for CAMERA_INFORMATION: MAVSDK hides an answer to anybody else."""
    encoder = mavlink.MAVLink(None, *ground)
    request = encoder.command_long_encode(1, 100, 512, 0, 259, 0, 0, 0, 0, 0, 0)
    request.pack(encoder)
    targets = [located(target_id=1 + now_ns // 2_000_000_000 % 100)]
    frames = publisher.update(targets, now_ns) + publisher.due(now_ns, now_ns // 1_000_000, (), vehicle())
    return frames + publisher.adsb(targets, now_ns) + publisher.handle(request, now_ns)


async def heard() -> dict[str, dict[str, Any]]:
    port = free_port(socket.SOCK_DGRAM)
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    ground = configuration.system_id, configuration.component_id
    publisher = MavlinkPublisher(Camera(1920, 1080, 1200.0, 1200.0, 959.5, 539.5), ground[:1])
    publisher.set_system(1)
    async with Mavsdk(configuration) as mavsdk:
        await mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            got: dict[str, dict[str, Any]] = {}
            complete = asyncio.Event()

            async def send() -> None:
                tick = 0
                while not complete.is_set():
                    for frame in everything(publisher, tick * 2_000_000_000, ground):
                        sender.sendto(frame, ("127.0.0.1", port))
                    tick += 1
                    try:
                        await asyncio.wait_for(complete.wait(), REPEAT_S)
                    except TimeoutError:
                        continue

            async def listen() -> None:
                while not (systems := await mavsdk.get_systems()):
                    await asyncio.wait({asyncio.create_task(complete.wait())}, timeout=REPEAT_S)
                async for message in MavlinkDirectAsync(systems[0]).subscribe_message(""):
                    if message.system_id == 1:
                        got[message.message_name] = json.loads(message.fields_json)
                    if got.keys() >= WANTED:
                        complete.set()
                        return

            sending = asyncio.create_task(send())
            try:
                await asyncio.wait_for(listen(), HANG_S)
            except TimeoutError:
                pytest.fail(f"not heard: {WANTED - got.keys()}")
            finally:
                complete.set()
                await sending
            return got


def test_mavsdk_reads_every_message_that_we_send() -> None:
    got = asyncio.run(heard())
    geo = got["CAMERA_TRACKING_GEO_STATUS"]
    assert (geo["lat"], geo["lon"], geo["tracking_status"]) == (474277400, 86055900, 1)
    assert geo["alt"] == pytest.approx(512.3456, rel=1e-6)
    assert geo["h_acc"] == pytest.approx(180.0 / math.sqrt(-2 * math.log(0.05)), rel=1e-4)
    assert geo["v_acc"] == pytest.approx(10.0, rel=1e-3)
    assert geo["dist"] == pytest.approx(4100.0)
    assert geo["hdg"] == pytest.approx(math.radians(-270.0), rel=1e-6)
    assert all(geo[name] is None or math.isnan(geo[name]) for name in NAN_AS_NULL)
    assert got["DEBUG_FLOAT_ARRAY"]["name"].startswith("FIRE_ELL")
    assert got["DEBUG_FLOAT_ARRAY"]["data"][7:9] == [180.0, 60.0]
    assert got["STATUSTEXT"]["text"].startswith("Smoke ")
