"""How the computer fares: from files as Linux, a Jetson and a Pi have them, and from those that say nonsense."""

from pathlib import Path

from service.common.host import HostReader, HostState
from service.flight.host_watch import HostWatch, faults_of


def put(root: Path, name: str, text: str) -> None:
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def stat(root: Path, first: tuple[int, int], second: tuple[int, int]) -> None:
    """Busy and idle ticks of two cores; iowait is idle, a guest's time is in the user's."""
    lines = [f"cpu{name}  {busy} 0 0 {idle} 0 0 0 0 {busy} 0" for name, (busy, idle) in (("0", first), ("1", second))]
    both = f"cpu  {first[0] + second[0]} 0 0 {first[1] + second[1]} 0 0 0 0 0 0"
    put(root, "proc/stat", "\n".join([both, *lines, "intr 1 2 3", "ctxt 5"]) + "\n")


def test_load_is_what_was_not_idle_between_two_looks(tmp_path: Path) -> None:
    reader = HostReader(tmp_path, tmp_path)
    stat(tmp_path, (100, 900), (0, 1000))
    reader.slice()
    assert reader.state().cores_percent == ()
    stat(tmp_path, (175, 925), (10, 1090))
    reader.slice()
    state = reader.state()
    assert state.cores_percent == (75.0, 10.0) and state.slices_percent == (42.5,)
    for _ in range(20):
        reader.slice()  # nothing has moved on
    assert reader.state().cores_percent == () and reader.state().slices_percent == (42.5,)


def test_slices_are_the_last_ten(tmp_path: Path) -> None:
    reader = HostReader(tmp_path, tmp_path)
    for number in range(30):
        stat(tmp_path, (number, 2 * number), (number, 2 * number))
        reader.slice()
    assert len(reader.state().slices_percent) == 10


def test_memory_pressure_and_heat(tmp_path: Path) -> None:
    put(tmp_path, "proc/meminfo", "MemTotal:        8192000 kB\nMemFree: 1 kB\nMemAvailable:    2048000 kB\n")
    put(tmp_path, "proc/pressure/memory", "some avg10=12.50 avg60=3.00 avg300=1.00 total=5\nfull avg10=1.00 total=1\n")
    put(tmp_path, "proc/pressure/cpu", "nonsense\n")
    zones = [
        ("cpu-thermal", "61500"),
        ("gpu-thermal", "55000"),
        ("cpu-thermal", "63000"),
        ("off", "-256000"),
        ("x", ""),
    ]
    for number, (kind, text) in enumerate(zones):
        put(tmp_path, f"sys/class/thermal/thermal_zone{number}/type", f"{kind}\n")
        put(tmp_path, f"sys/class/thermal/thermal_zone{number}/temp", f"{text}\n")
    put(tmp_path, "sys/devices/platform/gpu.0/load", "437\n")
    state = HostReader(tmp_path, tmp_path).state()
    assert (state.memory_total_mb, state.memory_used_mb) == (8000.0, 6000.0)
    assert state.pressure_percent == {"memory": 12.5}
    assert state.temperatures_c == {"cpu-thermal": 63.0, "gpu-thermal": 55.0}
    assert state.gpu_percent is not None and abs(state.gpu_percent - 43.7) < 1e-9


def test_a_board_that_slows_down(tmp_path: Path) -> None:
    reader = HostReader(tmp_path, tmp_path)
    put(tmp_path, "sys/devices/platform/soc/soc:firmware/get_throttled", "50005\n")
    state = reader.state()
    assert (state.is_under_voltage, state.is_cpu_throttled, state.is_too_hot) == (True, True, False)
    put(tmp_path, "sys/devices/platform/soc/soc:firmware/get_throttled", "0x80008\n")
    assert reader.state().is_too_hot and not reader.state().is_under_voltage
    put(tmp_path, "sys/devices/platform/soc/soc:firmware/get_throttled", "0\n")
    put(tmp_path, "sys/class/thermal/cooling_device0/type", "pwm-fan\n")
    put(tmp_path, "sys/class/thermal/cooling_device0/cur_state", "3\n")
    assert faults_of(reader.state()) == ()
    put(tmp_path, "sys/class/thermal/cooling_device1/type", "cpufreq-cpu0\n")
    put(tmp_path, "sys/class/thermal/cooling_device1/cur_state", "2\n")
    (fault,) = faults_of(reader.state())
    assert "too hot" in fault and "; " not in fault and ": give it air" in fault


def test_a_fault_is_logged_as_it_begins(tmp_path: Path, caplog) -> None:  # type: ignore[no-untyped-def]
    watch = HostWatch(HostReader(tmp_path, tmp_path))
    throttled = "sys/devices/platform/soc/soc:firmware/get_throttled"
    for text in ("0", "1", "1", "0", "1"):
        put(tmp_path, throttled, text)
        watch.look()
    assert [record.levelname for record in caplog.records] == ["WARNING"] * 2
    assert watch.state is not None and watch.state.is_under_voltage


def test_where_nothing_is_known_nothing_is_said(tmp_path: Path) -> None:
    assert HostReader(tmp_path / "gone", tmp_path).state() == HostState()
    for name in ("proc/stat", "proc/meminfo", "proc/pressure/io", "sys/devices/gpu.0/load"):
        put(tmp_path, name, "cpu cpu : \x00 some avg10=\n")
    assert HostReader(tmp_path / "gone", tmp_path).state() == HostState()


def test_the_disk_is_that_of_the_folder(tmp_path: Path) -> None:
    state = HostReader(tmp_path, tmp_path).state()
    assert state.storage_total_mb is not None and state.storage_used_mb is not None
    assert 0.0 < state.storage_used_mb < state.storage_total_mb
    assert HostState(storage_used_mb=999.5, storage_total_mb=1000.0).is_disk_full and not HostState().is_disk_full


def test_this_computer() -> None:
    reader = HostReader(Path("/"))
    state = reader.state()
    assert state.memory_total_mb and state.memory_used_mb and 0.0 < state.memory_used_mb < state.memory_total_mb
