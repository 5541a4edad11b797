"""ONBOARD_COMPUTER_STATUS: units, and MAVLink's values for what is not known, read back by its own decoder."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from distloc.geometry.camera import Camera
from service.common.host import HostState
from service.publish.mavlink import COMPUTER, ONBOARD, MavlinkPublisher
from service.publish.mavlink_messages import packed
from service.publish.onboard_computer import onboard_computer_status

NS = 1_000_000_000


def read(host: HostState, now_ns: int = 5 * NS) -> Any:
    raw = packed(mavlink.MAVLink(None, 1, COMPUTER), onboard_computer_status(host, now_ns))
    return mavlink.MAVLink(None).decode(bytearray(raw))


def test_all_that_is_known() -> None:
    host = HostState(
        cores_percent=(12.4, 99.6, *[50.0] * 10),
        slices_percent=(10.0, 20.0),
        gpu_percent=43.7,
        memory_used_mb=6000.4,
        memory_total_mb=8000.0,
        temperatures_c={"cpu-thermal": 63.4, "Tboard_tegra": 41.0, "gpu-thermal": 55.0},
        fans_rpm=(2400,),
        storage_used_mb=999.5,
        storage_total_mb=1000.0,
        storage_type=1,
        is_too_hot=True,
    )
    found = read(host, 90_061 * NS)
    assert found.time_usec == 90_061_000_000 and found.uptime == 90_061_000
    assert found.cpu_cores == [12, 100, 50, 50, 50, 50, 50, 50]
    assert found.cpu_combined == [10, 20, *[255] * 8] and found.gpu_cores == [44, 255, 255, 255]
    assert (found.ram_usage, found.ram_total) == (6000, 8000)
    assert found.temperature_board == 41 and found.temperature_core == [63, *[127] * 7]
    assert found.fan_speed == [2400, *[32767] * 3]
    assert found.storage_type[:2] == [1, 2**32 - 1] and found.storage_usage[0] == 1000
    assert found.status_flags == 4 + 8


def test_what_is_not_known_is_unused_as_mavlink_has_it() -> None:
    found = read(HostState())
    for name in ("cpu_cores", "cpu_combined", "gpu_cores", "gpu_combined"):
        assert set(getattr(found, name)) == {255}, name
    assert found.temperature_board == 127 and set(found.temperature_core) == {127}
    assert set(found.fan_speed) == {32767} and found.ram_usage == found.ram_total == 2**32 - 1
    for name in ("storage_type", "storage_usage", "storage_total", "link_type", "link_tx_rate", "link_rx_max"):
        assert set(getattr(found, name)) == {2**32 - 1}, name
    assert found.status_flags == 0


def test_a_value_that_would_read_as_unknown_is_the_nearest_that_does_not() -> None:
    host = HostState((250.0,), temperatures_c={"cpu": 150.0, "board": -300.0}, fans_rpm=(99_999,), memory_used_mb=1e12)
    found = read(host)
    assert found.cpu_cores[0] == 100 and found.temperature_core[0] == 126 and found.temperature_board == -128
    assert found.fan_speed[0] == 32766 and found.ram_usage == 2**32 - 2


def test_it_is_sent_every_five_seconds_and_as_asked() -> None:
    publisher = MavlinkPublisher(Camera(128, 64, 100.0, 100.0, 64.0, 32.0))
    publisher.set_system(1)

    def sent(at_ns: int) -> int:
        frames = publisher.due(at_ns, 0, (), None)
        return sum(frame[7] | frame[8] << 8 | frame[9] << 16 == ONBOARD for frame in frames)

    assert sent(0) == 0, "nothing is known yet"
    publisher.host = HostState()
    assert sum(sent(second * NS) for second in range(5, 25)) == 4
    command = mavlink.MAVLink_command_long_message(1, COMPUTER, 511, 0, ONBOARD, 1e6, 0, 0, 0, 0, 0)
    command._header = mavlink.MAVLink_header(76, 0, 0, 0, 0, 255, 190)
    publisher.handle(command, 25 * NS)
    assert sum(sent(second * NS) for second in range(26, 36)) == 10
