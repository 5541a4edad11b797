"""What computer this is, from the files of a Jetson, of a card's driver, and of neither."""

from pathlib import Path

from service.segmenters.accelerator.board import board_name, driver, gpu_nodes, is_jetson, tensorrt_version


def put(root: Path, name: str, data: bytes = b"") -> Path:
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path


def test_a_jetson(tmp_path: Path) -> None:
    put(tmp_path, "proc/device-tree/compatible", b"nvidia,p3768-0000+p3767-0000\0nvidia,tegra234\0")
    put(tmp_path, "proc/device-tree/model", b"NVIDIA Jetson Orin NX Engineering Reference Developer Kit\0")
    put(tmp_path, "etc/nv_tegra_release", b"# R36 (release), REVISION: 4.3\nmore\n")
    put(tmp_path, "usr/lib/aarch64-linux-gnu/libnvinfer.so.10.3.0")
    (tmp_path / "usr/lib/aarch64-linux-gnu/libnvinfer.so.10").symlink_to("libnvinfer.so.10.3.0")
    put(tmp_path, "dev/nvhost-gpu")
    put(tmp_path, "dev/nvmap")
    assert is_jetson(tmp_path)
    assert board_name(tmp_path) == "NVIDIA Jetson Orin NX Engineering Reference Developer Kit"
    assert driver(tmp_path) == "# R36 (release), REVISION: 4.3"
    assert tensorrt_version(tmp_path).split(", ")[0] == "10.3.0"
    assert [node.name for node in gpu_nodes(tmp_path)] == ["nvhost-gpu", "nvmap"]


def test_a_card(tmp_path: Path) -> None:
    put(tmp_path, "proc/driver/nvidia/gpus/0000:01:00.0/information", b"Model: \t\t NVIDIA RTX A2000\nIRQ: 1\n")
    put(tmp_path, "proc/driver/nvidia/version", b"NVRM version: NVIDIA UNIX x86_64  550.54\n")
    put(tmp_path, "dev/nvidia0")
    put(tmp_path, "dev/nvidiactl")
    assert board_name(tmp_path) == "NVIDIA RTX A2000" and not is_jetson(tmp_path)
    assert driver(tmp_path) == "NVRM version: NVIDIA UNIX x86_64  550.54"
    assert [node.name for node in gpu_nodes(tmp_path)] == ["nvidia0"]


def test_neither(tmp_path: Path) -> None:
    assert gpu_nodes(tmp_path) == [] and not is_jetson(tmp_path) and driver(tmp_path) == "unknown"
    assert board_name(tmp_path)
