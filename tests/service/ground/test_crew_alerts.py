"""A ground with a token and a record: whose alerts it takes by HTTP, and what of the fused fires is in its record."""

import json
import time
from pathlib import Path

import pytest

from service.ground.record.recorder import read
from service.ground.record.review import review
from tests.support.crew_ground import ground
from tests.support.drone_fleet import alert, post, tell, three
from tests.support.places import HANG_S
from tests.support.ports import free_port

TOKEN = "0123456789abcdefTower"


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Authorization": f"Bearer {TOKEN}"}, 202),
        ({}, 403),
        ({"Authorization": f"Bearer {TOKEN}x"}, 403),
        ({"Authorization": "Bearer"}, 403),
        ({"Authorization": f"Basic {TOKEN}"}, 403),
    ],
)
def test_an_alert_by_http_needs_the_token_as_a_bearers(tmp_path: Path, headers: dict[str, str], status: int) -> None:
    secret = tmp_path / "token"
    secret.write_text(TOKEN)
    secret.chmod(0o600)
    with ground("--listen", f"tcp/127.0.0.1:{free_port()}", "--token-file", str(secret)) as served:
        said, text = post(served.address.partition("?")[0], alert(), **headers)
    assert said == status and TOKEN not in text


def test_what_it_says_of_fused_fires_is_in_the_record_and_is_made_anew_from_it(tmp_path: Path) -> None:
    with three("--record", str(tmp_path)) as (drones, _):
        end_s, said = time.monotonic() + HANG_S, list[dict]()  # type: ignore[type-arg]
        while not said:
            assert time.monotonic() < end_s
            tell(drones[0], "drone1", 90.0, 8.0)
            tell(drones[1], "drone2", 0.0, -6.0)
            heard = [one for path in tmp_path.glob("*.jsonl") for one in read(path)]
            said = [json.loads(one.payload) for one in heard if "/fused/" in one.key and one.payload]
            time.sleep(0.1)
    assert said[0]["properties"]["contributors"] == ["drone1/1", "drone2/1"]
    page = review(heard, "a record").decode()
    assert "(fused of drone1/1, drone2/1" in page, page[page.find("<h2") :][:1500]
    without = review((one for one in heard if "/fused/" not in one.key), "a record").decode()
    assert without.count("fused of") == page.count("fused of")
