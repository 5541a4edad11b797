"""A damaged DataFlash log loses the records that are damaged, and no others."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from service.recordings.importers.flight import Given
from service.recordings.importers.logs.dataflash import read_dataflash
from service.recordings.importers.logs.undamaged import undamaged_copy
from tests.support.dataflash import write_dataflash
from tests.support.flown import Flown
from tests.support.places import HANG_S


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return write_dataflash(tmp_path_factory.mktemp("log") / "log.bin", Flown()).read_bytes()


def heads(data: bytes) -> list[int]:
    """Where records begin."""
    return [at for at in range(len(data) // 3, len(data) - 3) if data[at : at + 2] == b"\xa3\x95"]


def test_a_record_of_an_unknown_type_costs_itself(log: bytes, tmp_path: Path) -> None:
    data = bytearray(log)
    for at in heads(log)[:600:200]:
        data[at + 2] ^= 0xFF
    path = tmp_path / "flipped.bin"
    path.write_bytes(data)
    flight = read_dataflash(path, Given())
    whole = tmp_path / "whole.bin"
    whole.write_bytes(log)
    true = read_dataflash(whole, Given())
    assert flight.craft is not None and true.craft is not None
    assert flight.positions is not None and true.positions is not None
    lost = len(true.craft.time_s) + len(true.positions.time_s) - len(flight.craft.time_s) - len(flight.positions.time_s)
    assert 0 <= lost <= 6
    assert flight.remarks.dropped["place in the log where records are damaged"] == 3
    assert "place in the log where records are damaged" not in true.remarks.dropped


def test_a_log_of_random_flips_is_read_to_its_end_without_noise(log: bytes, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    data = bytearray(log)
    for at in rng.integers(len(data) // 4, len(data), 30):
        data[at] ^= 1 << int(rng.integers(8))
    path = tmp_path / "flipped.bin"
    path.write_bytes(data)
    code = (
        "import sys; from pathlib import Path; from service.recordings.importers.flight import Given; "
        "from service.recordings.importers.logs.dataflash import read_dataflash; "
        "f = read_dataflash(Path(sys.argv[1]), Given()); t = f.craft.time_s; print(len(t), t[-1] - t[0])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(path)],
        capture_output=True,
        text=True,
        check=True,
        timeout=HANG_S,
    )
    number, seconds = done.stdout.split()
    assert done.stderr == ""
    assert int(number) > 450 and 19.0 < float(seconds) < 21.0


def test_noise_has_no_record(tmp_path: Path) -> None:
    path = tmp_path / "noise.bin"
    path.write_bytes(np.random.default_rng(1).bytes(50_000))
    undamaged_copy(path, tmp_path / "copy.bin")
    assert (tmp_path / "copy.bin").stat().st_size < 1000
