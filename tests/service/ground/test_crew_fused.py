"""A ground that hears several drones and a tower: others are told of one fire where the page shows one."""

import asyncio
import csv
import io
import json
import time
import urllib.request
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import msgspec
import pytest

from service.ground.picture.marks import Mark
from tests.support import ogr
from tests.support.drone_fleet import alert, post, tell, three
from tests.support.places import HANG_S
from tests.support.shared_fires import area_m2
from tests.support.tak_map import Client
from tests.support.tak_server import Server
from tests.support.told import live
from tests.support.told import until as told


class Others:
    """What a TAK client and programs see of one ground."""

    def __init__(self, server: Server, address: str) -> None:
        self._server, self._address = server, address

    def fires(self) -> dict[str, str]:
        """The fires on the map of a client that heard all so far: titles by uid, each with its region."""
        client = Client()
        client.take(self._server.events(), time.time())
        shown = {uid: one.title for uid, (one, _) in client.markers.items() if one.kind.startswith("a-u-X")}
        return {uid: title for uid, title in shown.items() if f"{uid}.region" in client.drawings}

    def get(self, path: str) -> bytes:
        return bytes(urllib.request.urlopen(f"{self._address}{path}").read())

    def points(self) -> list[dict]:  # type: ignore[type-arg]
        """The fires of the GeoJSON feed."""
        return [one for one in json.loads(self.get("fires.geojson"))["features"] if one["geometry"]["type"] == "Point"]

    def said(self) -> dict[str, dict]:  # type: ignore[type-arg]
        """Their properties by uid."""
        return {one["id"]: one["properties"] for one in self.points()}

    def until(self, is_so: Callable[[], bool]) -> None:
        end_s = time.monotonic() + HANG_S
        while not is_so():
            assert time.monotonic() < end_s, self.fires()
            time.sleep(0.05)


def marked(address: str, *marks: Mark) -> None:
    async def send() -> None:
        async with live(address) as page:
            await told(page, lambda news: bool(news.fires))
            for mark in marks:
                await page.send_str(msgspec.json.encode(mark).decode())

    asyncio.run(send())


def test_one_fire_of_two_drones_is_one_on_all_maps_until_they_part(tmp_path: Path) -> None:
    with Server() as server, three("--tak", f"tcp://127.0.0.1:{server.port}") as (drones, address):
        others = Others(server, address)
        tell(drones[0], "drone1", 90.0, 8.0)
        others.until(lambda: len(others.fires()) == 1)
        (alone,) = others.fires()
        assert alone.startswith("distloc.drone1.1.")

        tell(drones[1], "drone2", 0.0, -6.0)
        fused = alone.replace("distloc.", "distloc.fused.", 1)
        others.until(lambda: set(others.fires()) == {fused})
        assert others.fires()[fused].startswith("Fire drone1/1 +1 +-")
        same_everywhere(others, server, fused, tmp_path)

        tell(drones[2], "drone3", 225.0, 330.0)
        others.until(lambda: len(others.fires()) == 2)
        others.until(lambda: any("outvoted" in title for title in others.fires().values()))
        contradicted = next(said for uid, said in others.said().items() if uid != fused)
        assert (contradicted["outvoted_by"], contradicted["contributors"]) == ("drone1/1", "")
        assert contradicted["outvoted_away_m"] == pytest.approx(330.0, abs=20.0)

        assert post(address, alert(180.5))[0] == 202
        others.until(lambda: others.said()[fused]["towers"] == "tower1")
        marked(address, Mark(vehicle="drone2", target=1, time_s=0.0, name="Mill"))
        others.until(lambda: others.fires()[fused].startswith("Mill +-"))

        tell(drones[1], "drone2", 0.0, 3_000.0)  # it looks at another fire now
        others.until(lambda: any(uid.startswith("distloc.drone2.1.") for uid in others.fires()))
        assert fused in others.fires()  # under its uid with one drone and the tower as well
        marked(address, *(Mark(vehicle=f"drone{n}", target=1, time_s=0.0, verdict="not_a_fire") for n in (1, 2, 3)))
        others.until(lambda: others.fires() == {})
        assert [one["not_a_fire"] for one in others.said().values()] == [True] * 3


def same_everywhere(others: Others, server: Server, fused: str, folder: Path) -> None:
    """One fire with one place, size and uid in each form; its region as large as told, its errors by its ellipse."""
    (point,) = others.points()
    said = point["properties"]
    assert (said["uid"], said["contributors"]) == (fused, "drone1/1 drone2/1")
    axes = said["ellipse95_semi_major_m"], said["ellipse95_semi_minor_m"]
    assert axes[0] < 60.0  # each alone: 130
    event = max((one for one in server.events() if one.uid == fused), key=lambda one: one.title)
    assert event.lat_lon == pytest.approx(point["geometry"]["coordinates"][1::-1], abs=1e-6)
    assert event.ce90_m == pytest.approx(said["ce90_m"], abs=0.2)
    assert 0.67 * axes[0] < said["ce90_m"] < 0.88 * axes[0]
    region = [one for one in server.events() if one.uid == f"{fused}.region"][-1]
    assert area_m2(region.corners) == pytest.approx(3.14159265 * axes[0] * axes[1], rel=0.02)

    (row,) = csv.DictReader(io.StringIO(others.get("fires.csv").decode()))
    assert (row["uid"], row["contributors"]) == (fused, "drone1/1 drone2/1")
    path = folder / "fires.kml"
    path.write_bytes(others.get("fires.kml"))
    fires = [one for one in ogr.features(str(path)) if one.fields["uid"]]
    assert [one.fields["uid"] for one in fires] == [fused]
    assert "one fire of drone1/1, drone2/1" in str(fires[0].fields["description"])
    (item,) = json.loads(others.get("collections/fires/items"))["features"]
    assert item["id"] == fused
    for asked in ("drone1/1", "drone2/1", fused):
        draft = ElementTree.fromstring(others.get(f"fires/cap?fire={asked}"))
        assert (draft.findtext("{*}identifier") or "").startswith(f"{fused}.")
