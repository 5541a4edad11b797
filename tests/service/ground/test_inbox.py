"""The inbox: the newest of each key, bounded whatever comes."""

from service.ground.inbox import MOST_KEYS_EACH, MOST_SENDERS, Inbox
from tests.support.ground_samples import heard


def test_a_flood_of_one_key_is_one_message_and_no_loss() -> None:
    inbox = Inbox()
    for number in range(10_000):
        inbox.put(heard("drone1/targets/1", str(number).encode()))
    messages, dropped = inbox.take()
    assert [one.payload for one in messages] == [b"9999"] and dropped == {}
    assert inbox.take() == ([], {})


def test_a_flood_of_keys_and_of_names_is_counted_by_its_sender() -> None:
    inbox = Inbox()
    inbox.put(heard("good/targets/1", b"1"))
    for number in range(MOST_KEYS_EACH + 7):
        inbox.put(heard(f"bad/targets/{number}", b"1"))
    for number in range(2 * MOST_SENDERS):
        inbox.put(heard(f"name{number}/status", b"1"))
    messages, dropped = inbox.take()
    assert len(messages) == 1 + MOST_KEYS_EACH + MOST_SENDERS - 2 and messages[0].key == "distloc/good/targets/1"
    assert dropped["bad"] == 7 and len(dropped) <= MOST_SENDERS
