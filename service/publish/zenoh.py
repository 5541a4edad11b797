"""Publishes reports, vehicle, status and preview over zenoh, from its own thread: no link can hold up the rest.

Keys are in docs and DESIGN: `distloc/VEHICLE/{targets/ID,vehicle,status,preview,alive}`.
"""

import contextlib
import json
import logging
import random
import re
import threading
from collections import OrderedDict
from typing import Any

import zenoh
import zenoh.ext

from distloc.backports import Self
from service.config.secret_file import public_path, read_secret, secret_path
from service.config.sections import ConfigError, ZenohConfig

_log = logging.getLogger(__name__)

MAX_TARGETS = 64
RETRY_FIRST_S = 0.5
RETRY_MAX_S = 5.0
CLOSE_TIMEOUT_S = 5.0
GEOJSON = "application/geo+json"
JSON = "application/json"
JPEG = "image/jpeg"


def zenoh_config(config: ZenohConfig) -> zenoh.Config:
    """zenoh's configuration with nothing open that was not asked for; ConfigError where zenoh refuses a value."""
    made = zenoh.Config()
    settings: dict[str, object] = {
        "mode": config.mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "connect/endpoints": list(config.connect),
        "listen/endpoints": list(config.listen),
        "timestamping/enabled": True,  # the cache for late joiners orders its samples by time
    }
    settings.update(_tls(config))
    if config.user or config.password_file:
        settings["transport/auth/usrpwd/user"] = config.user
        settings["transport/auth/usrpwd/password"] = _password(config)
    if config.listen and config.user and not config.users_file:
        raise ConfigError("zenoh.users_file is empty: with a user, nobody could connect to zenoh.listen without it")
    if config.users_file:
        users = secret_path("zenoh.users_file", config.users_file)
        settings["transport/auth/usrpwd/dictionary_file"] = str(users)
    for key, value in settings.items():
        try:
            made.insert_json5(key, json.dumps(value))
        except zenoh.ZError as error:
            shown = "(hidden)" if "password" in key else value
            raise ConfigError(f"zenoh: {key} is {shown}: {str(error).splitlines()[0]}") from error
    return made


def _tls(config: ZenohConfig) -> dict[str, object]:
    if bool(config.certificate) != bool(config.private_key):
        raise ConfigError("zenoh: certificate and private_key belong together: give both or neither")
    tls: dict[str, object] = {}
    if config.ca_certificate:
        tls["transport/link/tls/root_ca_certificate"] = str(public_path("zenoh.ca_certificate", config.ca_certificate))
    if config.certificate:
        certificate = str(public_path("zenoh.certificate", config.certificate))
        key = str(secret_path("zenoh.private_key", config.private_key))
        for side in ("listen", "connect"):
            tls[f"transport/link/tls/{side}_certificate"] = certificate
            tls[f"transport/link/tls/{side}_private_key"] = key
        tls["transport/link/tls/enable_mtls"] = bool(config.ca_certificate)
    return tls


def _password(config: ZenohConfig) -> str:
    if not (config.user and config.password_file):
        raise ConfigError("zenoh: user and password_file belong together: give both or neither")
    try:
        return read_secret("zenoh.password_file", config.password_file).decode().strip()
    except UnicodeDecodeError as error:
        raise ConfigError(f"zenoh.password_file is {config.password_file}: not text") from error


class ZenohPublisher:
    """Hands payloads to a thread that publishes them; of two for one key that wait, the newer goes and one is dropped.

    `state` is closed, opening, open, or retrying: why. Raises ConfigError on construction.
    """

    def __init__(self, config: ZenohConfig, vehicle: str) -> None:
        self._config = zenoh_config(config)
        self._prefix = f"distloc/{vehicle}"
        self._connect_ports = frozenset(re.findall(r":(\d+)", " ".join(config.connect)))
        self._is_apart = False
        self._state = "closed"
        self._published = 0
        self._dropped = 0
        self._pending: OrderedDict[str, tuple[str, bytes]] = OrderedDict()
        self._last: OrderedDict[str, bytes] = OrderedDict()  # per target, for the queryable
        self._changed = threading.Condition()
        self._closing = False
        self._thread: threading.Thread | None = None

    @property
    def state(self) -> str:
        """One line for the status."""
        return self._state

    @property
    def is_lost(self) -> bool:
        """Whether there is no session, or none of the peers and routers that it should connect to is there."""
        return self._state.startswith("retrying") or self._is_apart

    @property
    def counters(self) -> dict[str, int | float | str | None]:
        """For the status message."""
        return {"zenoh_state": self._state, "zenoh_published": self._published, "zenoh_dropped": self._dropped}

    def open(self) -> None:
        """Start the thread; returns at once. A busy port or a missing peer is retried behind."""
        if self._thread is None:
            self._closing = False
            self._state = "opening"
            self._thread = threading.Thread(target=self._run, name="zenoh", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Publish what waits, if there is a session, then close it."""
        if self._thread is None:
            return
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._thread.join(CLOSE_TIMEOUT_S)
        self._thread = None
        self._state = "closed"

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *_exception: object) -> None:
        self.close()

    def publish_report(self, target_id: int, payload: bytes) -> None:
        """A target's GeoJSON; the last of each of the newest MAX_TARGETS is kept for late joiners."""
        key = f"{self._prefix}/targets/{target_id}"
        with self._changed:
            self._last[key] = payload
            self._last.move_to_end(key)
            if len(self._last) > MAX_TARGETS:
                self._last.popitem(last=False)
        self._put(key, GEOJSON, payload)

    def publish_vehicle(self, payload: bytes) -> None:
        """JSON of the vehicle."""
        self._put(f"{self._prefix}/vehicle", JSON, payload)

    def publish_status(self, payload: bytes) -> None:
        """JSON of the service's health."""
        self._put(f"{self._prefix}/status", JSON, payload)

    def publish_preview(self, jpeg: bytes) -> None:
        """An annotated JPEG."""
        self._put(f"{self._prefix}/preview", JPEG, jpeg)

    def _put(self, key: str, encoding: str, payload: bytes) -> None:
        with self._changed:
            if self._closing:
                self._dropped += 1
                return
            self._dropped += self._pending.pop(key, None) is not None
            self._pending[key] = (encoding, payload)
            if len(self._pending) > MAX_TARGETS + 3:
                self._pending.popitem(last=False)
                self._dropped += 1
            self._changed.notify_all()

    def _run(self) -> None:
        wait_s = RETRY_FIRST_S
        while not self._closing:
            try:
                with zenoh.open(self._config) as session:
                    wait_s = RETRY_FIRST_S
                    self._serve(session)
            except Exception as error:  # whatever it is, a thread that dies would say nothing any more
                reason = next(iter(str(error).splitlines()), type(error).__name__)
                if self._state != f"retrying: {reason}":
                    _log.warning("zenoh is not open, trying again: %s", reason)
                self._tell(f"retrying: {reason}")
                with self._changed:
                    self._changed.wait_for(lambda: self._closing, wait_s * random.uniform(0.8, 1.2))
                wait_s = min(RETRY_MAX_S, wait_s * 2)

    def _serve(self, session: zenoh.Session) -> None:
        with contextlib.ExitStack() as declared:
            declared.enter_context(session.declare_queryable(f"{self._prefix}/targets/*", self._answer))
            declared.enter_context(session.liveliness().declare_token(f"{self._prefix}/alive"))
            publishers: OrderedDict[str, Any] = OrderedDict()
            self._tell("open")
            _log.info("zenoh is open")
            while True:
                with self._changed:
                    self._changed.wait_for(lambda: self._closing or self._pending)
                    waiting, self._pending = self._pending, OrderedDict()
                    closing = self._closing
                self._is_apart = self._has_no_link(session)
                for key, (encoding, payload) in waiting.items():
                    self._send(session, publishers, key, encoding, payload)
                if closing:
                    return

    def _has_no_link(self, session: zenoh.Session) -> bool:
        """By the ports, as a name in the config is an address in the link; zenoh itself tries again behind."""
        return bool(self._connect_ports) and not any(
            str(link.dst).rpartition(":")[2] in self._connect_ports for link in session.info.links()
        )

    def _send(
        self, session: zenoh.Session, publishers: OrderedDict[str, Any], key: str, encoding: str, payload: bytes
    ) -> None:
        if encoding != GEOJSON:
            session.put(key, payload, encoding=encoding, congestion_control=zenoh.CongestionControl.DROP)
        else:
            if key not in publishers:
                publishers[key] = _cached_publisher(session, key)
            publishers.move_to_end(key)
            publishers[key].put(payload)
            if len(publishers) > MAX_TARGETS:
                publishers.popitem(last=False)[1].undeclare()
        with self._changed:
            self._published += 1
            self._changed.notify_all()

    def _tell(self, state: str) -> None:
        with self._changed:
            self._state = state
            self._changed.notify_all()

    def _answer(self, query: zenoh.Query) -> None:
        with self._changed:
            last = list(self._last.items())
        with query:
            for key, payload in last:
                if query.key_expr.intersects(zenoh.KeyExpr(key)):
                    query.reply(key, payload, encoding=GEOJSON)


def _cached_publisher(session: zenoh.Session, key: str) -> Any:
    return zenoh.ext.declare_advanced_publisher(
        session,
        key,
        encoding=GEOJSON,
        congestion_control=zenoh.CongestionControl.DROP,
        cache=zenoh.ext.CacheConfig(max_samples=1),
        publisher_detection=True,
    )


class NullPublisher:
    """zenoh switched off."""

    state = "off"
    is_lost = False

    @property
    def counters(self) -> dict[str, int | float | str | None]:
        """Nothing to count."""
        return {}

    def open(self) -> None:
        """Does nothing."""

    def close(self) -> None:
        """Does nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_exception: object) -> None:
        """Does nothing."""

    def publish_report(self, target_id: int, payload: bytes) -> None:
        """Does nothing."""

    def publish_vehicle(self, payload: bytes) -> None:
        """Does nothing."""

    def publish_status(self, payload: bytes) -> None:
        """Does nothing."""

    def publish_preview(self, jpeg: bytes) -> None:
        """Does nothing."""
