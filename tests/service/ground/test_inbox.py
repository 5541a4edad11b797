"""The inbox: the newest of each key, bounded whatever comes."""

import itertools

from service.ground.inbox import MOST_KEYS_EACH, MOST_SENDERS, Inbox


def test_a_flood_of_one_key_is_one_message_and_no_loss() -> None:
    inbox = Inbox()
    for number in range(10_000):
        inbox.put("distloc/drone1/targets/1", str(number).encode())
    messages, dropped = inbox.take()
    assert [one.payload for one in messages] == [b"9999"] and dropped == {}
    assert inbox.take() == ([], {})


def test_a_flood_of_keys_and_of_names_is_counted_by_its_sender() -> None:
    inbox = Inbox()
    inbox.put("distloc/good/targets/1", b"1")
    for number in range(MOST_KEYS_EACH + 7):
        inbox.put(f"distloc/bad/targets/{number}", b"1")
    for number in range(2 * MOST_SENDERS):
        inbox.put(f"distloc/name{number}/status", b"1")
    messages, dropped = inbox.take()
    assert len(messages) == 1 + MOST_KEYS_EACH + MOST_SENDERS - 2 and messages[0].key == "distloc/good/targets/1"
    assert dropped["bad"] == 7 and len(dropped) <= MOST_SENDERS


def test_what_is_taken_arrived_before_all_that_is_taken_later() -> None:
    """However late its time is read: the record says until when all is on the disk."""
    now = itertools.count(1.0)
    inbox = Inbox(lambda: next(now))
    inbox.put("distloc/b/status", b"1")
    inbox.put("distloc/a/status", b"1")
    first, _ = inbox.take()
    inbox.put("distloc/b/status", b"2")
    later, _ = inbox.take()
    assert max(one.arrived_s for one in first) < min(one.arrived_s for one in later)
