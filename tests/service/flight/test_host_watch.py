"""How the computer fares goes out with the flight's status and over MAVLink."""

import time

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from service.publish.mavlink import ONBOARD
from service.publish.wire import encode
from tests.support.running_app import Sender, run, running, until


def test_the_status_and_the_ground_station_have_it() -> None:
    async def body() -> None:
        async with running() as app:
            await until(lambda: app.host.state is not None, "a look at the computer")
            host = app.status(time.monotonic_ns()).host
            assert host.memory_total_mb > 0.0 and b'"memory_total_mb":' in encode(app.status(time.monotonic_ns()))
            with Sender(app) as sender:

                def has_come() -> bool:
                    sender.heartbeat()
                    sender.hear()
                    decoder = mavlink.MAVLink(None)
                    decoder.robust_parsing = True
                    return any(one.get_msgId() == ONBOARD for one in decoder.parse_buffer(sender.received) or ())

                await until(has_come, "ONBOARD_COMPUTER_STATUS")

    run(body())
