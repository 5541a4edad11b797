"""The ground's ends of zenoh: all that drones tell goes into the inbox, marks go to and fro between grounds."""

import threading
from collections.abc import Sequence

import msgspec
import zenoh

from distloc.backports import Self
from service.config.sections import ZenohConfig
from service.ground.inbox import Inbox
from service.ground.picture.marks import Mark
from service.ground.subscriber import GET_TIMEOUT_S, Subscriber

VEHICLES, PREVIEWS, MARKS = "distloc/*/vehicle", "distloc/*/preview", "distloc/*/marks/*"
ALERTS = "distloc/*/alerts/**"  # a tower's, on one key or on one for each direction
_JSON = "application/json"


class GroundLink:
    """Open in a `with`. `marks` gives what this ground knows, for others that ask; called on zenoh's threads."""

    def __init__(
        self,
        connect: Sequence[str],
        listen: Sequence[str],
        access: ZenohConfig | None,
        inbox: Inbox,
    ) -> None:
        self._inbox = inbox
        self._marks: tuple[Mark, ...] = ()
        self._lock = threading.Lock()
        self._subscriber = Subscriber(connect, inbox.put, listen, access, inbox.put, self._on_alive)

    def __enter__(self) -> Self:
        self._subscriber.open()
        session = self._subscriber.session
        for key in (VEHICLES, PREVIEWS, MARKS, ALERTS):
            session.declare_subscriber(key, self._on_sample)
        session.declare_queryable(MARKS, self._answer)
        return self

    def __exit__(self, *_exception: object) -> None:
        self._subscriber.close()

    def linked(self) -> dict[str, bool]:
        """Whether there is a link to each endpoint."""
        return self._subscriber.linked()

    def know(self, marks: Sequence[Mark]) -> None:
        """What others that ask are told: one of each key, of the fire of that number that was first seen last."""
        with self._lock:
            self._marks = tuple({_key(one): one for one in marks}.values())

    def put(self, key: str, payload: bytes) -> None:
        """JSON, to all."""
        self._subscriber.session.put(key, payload, encoding=_JSON)

    def tell(self, mark: Mark) -> None:
        """A new mark, to all."""
        self.put(_key(mark), msgspec.json.encode(mark))

    def ask(self) -> None:
        """Other grounds for their marks: some may have come late."""
        self._subscriber.session.get(MARKS, self._on_reply, timeout=GET_TIMEOUT_S)

    def _on_alive(self, key: str, is_there: bool) -> None:
        self._inbox.put(key, b"" if is_there else None)

    def _on_sample(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            sender = "" if sample.timestamp is None else str(sample.timestamp.get_id())
            self._inbox.put(str(sample.key_expr), sample.payload.to_bytes(), sender)

    def _on_reply(self, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self._on_sample(reply.ok)

    def _answer(self, query: zenoh.Query) -> None:
        with self._lock:
            marks = self._marks
        with query:
            for mark in marks:
                if query.key_expr.intersects(zenoh.KeyExpr(_key(mark))):
                    query.reply(_key(mark), msgspec.json.encode(mark), encoding=_JSON)


def _key(mark: Mark) -> str:
    return f"distloc/{mark.vehicle}/marks/{mark.target}"
