"""Commands over a real socket: those of a configured system are done, a stranger's are counted and nothing more."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from service.mavlink.framer import Framer, decode
from tests.support.running_app import Sender, heard, run, running, until

CAMERA, CAMERA_INFORMATION, HEARTBEAT = 100, 259, 0


def request(sender: Sender, as_int: bool) -> bytes:
    """REQUEST_MESSAGE for CAMERA_INFORMATION."""
    if as_int:
        return sender.pack(mavlink.MAVLink_command_int_message(1, CAMERA, 0, 512, 0, 0, CAMERA_INFORMATION, *[0] * 6))
    return sender.pack(mavlink.MAVLink_command_long_message(1, CAMERA, 512, 0, CAMERA_INFORMATION, *[0] * 6))


def slow_down(sender: Sender) -> bytes:
    """SET_MESSAGE_INTERVAL: the camera's HEARTBEAT once an hour."""
    return sender.pack(mavlink.MAVLink_command_long_message(1, CAMERA, 511, 0, HEARTBEAT, 3.6e9, 0, 0, 0, 0, 0))


def answers(sender: Sender) -> list[Any]:
    """COMMAND_ACK and CAMERA_INFORMATION among all that came back so far."""
    sender.hear()
    messages = [decode(frame) for frame in Framer().feed(sender.received)]
    return [one.get_type() for one in messages if one.get_type() in ("COMMAND_ACK", "CAMERA_INFORMATION")]


@pytest.mark.parametrize("as_int", [False, True])
def test_only_configured_systems_command(as_int: bool, caplog: pytest.LogCaptureFixture) -> None:
    async def body() -> None:
        async with running(command_systems=(245, 250)) as app:
            with Sender(app) as autopilot, Sender(app, 250, 190) as crew, Sender(app, 255, 190) as stranger:
                autopilot.heartbeat()
                await until(lambda: heard(app), "the autopilot")
                await until(lambda: app.outgoing.mavlink._system, "our id")
                stranger.send(request(stranger, as_int) + slow_down(stranger))
                await until(lambda: app.counters()["commands"] == {"taken": 0, "refused": 2}, "the refusals")
                crew.send(request(crew, as_int))
                await until(lambda: answers(crew) == ["COMMAND_ACK", "CAMERA_INFORMATION"], "the answer")
                assert app.counters()["commands"] == {"taken": 1, "refused": 2}
                assert app.counters()["commands_refused_of"] == [255]
                assert [
                    one.getMessage() for one in caplog.records if "command_systems is [245, 250]" in one.getMessage()
                ]
                assert sum("a command of system 255 is refused" in one.getMessage() for one in caplog.records) == 1
                assert answers(stranger).count("CAMERA_INFORMATION") <= 1  # the crew's, as all on a link hear it
                assert app.outgoing.mavlink._interval_ns[CAMERA, HEARTBEAT] == 10**9

    run(body())


def test_a_command_to_somebody_else_is_neither_taken_nor_refused() -> None:
    async def body() -> None:
        async with running() as app:
            with Sender(app) as autopilot, Sender(app, 9, 190) as other:
                autopilot.heartbeat()
                await until(lambda: app.outgoing.mavlink._system, "our id")
                other.send(other.pack(mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)))
                other.send(request(other, False))
                await until(lambda: app.counters()["commands"] == {"taken": 0, "refused": 1}, "the one refusal")

    run(body())
