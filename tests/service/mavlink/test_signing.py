"""Signed MAVLink over real sockets: the key's holder is heard, each kind of intruder is refused and counted."""

import asyncio
import contextlib
import re
import socket
import struct
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from service.commands.check.doctor import run_check
from service.commands.check.finding import Finding
from service.commands.check.links import check_links
from service.common.messages import MavFrame
from service.config.sections import Config, ConfigError, LinkConfig, MavlinkConfig
from service.mavlink.carrier import MOST_PEERS
from service.mavlink.framer import Framer
from service.mavlink.signing import CLOCK_SET_TICKS, EPOCH_NS, MOST_STREAMS, TICK_NS, Keyring, signing_of_links
from tests.support.ports import free_port
from tests.support.running_app import Sender, heard, refused, run, running, ticks_now, until

KEY = bytes(range(32))
OTHER_KEY = bytes(range(1, 33))
DAY = 86_400 * 100_000
NOW_NS = 1_800_000_000 * 10**9
NOW = (NOW_NS - EPOCH_NS) // TICK_NS
BEAT = mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3)


@pytest.fixture
def key_file(tmp_path: Path) -> str:
    path = tmp_path / "mavlink.key"
    path.write_bytes(KEY.hex().encode() + b"\n")
    path.chmod(0o600)
    return str(path)


def unsigned(intruder: Sender, _: bytes) -> bytes:
    return intruder.pack(BEAT)


def version_1(intruder: Sender, _: bytes) -> bytes:
    return intruder.pack(BEAT, force_mavlink1=True)


def wrong_key(intruder: Sender, _: bytes) -> bytes:
    intruder.mav.signing.secret_key, intruder.mav.signing.sign_outgoing = OTHER_KEY, True
    intruder.mav.signing.timestamp = ticks_now()
    return intruder.pack(BEAT)


def forged_future(intruder: Sender, _: bytes) -> bytes:
    forged = wrong_key(intruder, _)
    return forged[:-12] + b"\xff" * 6 + forged[-6:]


def replayed(_: Sender, recorded: bytes) -> bytes:
    return recorded


def moved_to_another_link(_: Sender, recorded: bytes) -> bytes:
    return recorded[:-13] + bytes([recorded[-13] ^ 1]) + recorded[-12:]


def stamped_anew(_: Sender, recorded: bytes) -> bytes:
    return recorded[:-12] + struct.pack("<Q", ticks_now() + 1000)[:6] + recorded[-6:]


def signed_in_the_future(intruder: Sender, _: bytes) -> bytes:
    intruder.mav.signing.secret_key, intruder.mav.signing.sign_outgoing = KEY, True
    intruder.mav.signing.timestamp = ticks_now() + 20 * 365 * DAY
    return intruder.pack(BEAT)


def recorded_long_ago_from_another_sender(intruder: Sender, _: bytes) -> bytes:
    intruder.mav.signing.secret_key, intruder.mav.signing.sign_outgoing = KEY, True
    intruder.mav.signing.timestamp, intruder.mav.signing.link_id = ticks_now() - DAY, 9
    return intruder.pack(BEAT)


@pytest.mark.parametrize(
    ("attack", "reason"),
    [
        (unsigned, "unsigned"),
        (version_1, "unsigned"),
        (wrong_key, "wrong_signature"),
        (forged_future, "wrong_signature"),
        (moved_to_another_link, "wrong_signature"),
        (stamped_anew, "wrong_signature"),
        (replayed, "replayed"),
        (signed_in_the_future, "future"),
        (recorded_long_ago_from_another_sender, "too_old"),
    ],
)
def test_an_intruder_is_refused_and_the_true_sender_goes_on(
    key_file: str, attack: Callable[[Sender, bytes], bytes], reason: str
) -> None:
    async def body() -> None:
        async with running(signing_key=key_file) as app:
            with Sender(app, key=KEY) as honest, Sender(app) as intruder:
                recorded = honest.heartbeat()
                await until(lambda: heard(app) == 1, "the true sender")
                intruder.send(attack(intruder, recorded))
                await until(lambda: refused(app) == {reason: 1}, f"a refusal: {reason}")
                assert heard(app) == 1
                honest.heartbeat()
                await until(lambda: heard(app) == 2, "the true sender after the attack")
                await until(honest.hear, "what the service says")
                assert intruder.hear() == b""  # nor is it told anything

    run(body())


@pytest.mark.parametrize("attack", [unsigned, version_1, wrong_key, forged_future, signed_in_the_future])
def test_an_intruder_who_comes_first_is_not_taken_for_the_autopilot(
    key_file: str, attack: Callable[[Sender, bytes], bytes]
) -> None:
    async def body() -> None:
        async with running(signing_key=key_file) as app:
            with Sender(app, 66) as intruder, Sender(app, 7, key=KEY) as honest:
                intruder.send(attack(intruder, b""))
                await until(lambda: sum(refused(app).values()) == 1, "a refusal")
                assert app.autopilot.target_system == 0
                honest.heartbeat()
                await until(lambda: app.autopilot.target_system == 7, "the true autopilot")

    run(body())


def test_what_we_send_is_right_in_pymavlinks_own_check(key_file: str) -> None:
    """pymavlink's signing code, fed with the service's bytes; one whose key differs takes none of them."""

    async def body() -> None:
        async with running(signing_key=key_file) as app:
            with Sender(app, key=KEY) as honest:
                checker, other = mavlink.MAVLink(None), mavlink.MAVLink(None)
                checker.signing.secret_key, other.signing.secret_key = KEY, OTHER_KEY
                kinds: set[str] = set()

                def read() -> bool:
                    for frame in Framer().feed(honest.hear()):
                        assert other.parse_buffer(frame.raw)[0].get_type() == "BAD_DATA"
                        kinds.add(checker.parse_buffer(frame.raw)[0].get_type())
                    return kinds >= {"HEARTBEAT", "TIMESYNC", "COMMAND_LONG"} and checker.signing.sig_count > 20

                checker.robust_parsing = other.robust_parsing = True
                honest.heartbeat()
                await until(read, "20 messages of three kinds")
                assert "BAD_DATA" not in kinds and checker.signing.badsig_count == 0
                assert other.signing.goodsig_count == 0
                assert checker.signing.goodsig_count == checker.signing.sig_count

    run(body())


def test_a_link_that_is_a_wire_may_stay_unsigned(key_file: str) -> None:
    links = (LinkConfig(url="udpin:127.0.0.1:0"), LinkConfig(url="serial:/dev/ttyS9:57600", signed=False))
    air, wire = signing_of_links(MavlinkConfig(links=links, signing_key=key_file), time.time_ns)
    frame = framed(mavlink.MAVLink(None, 1, 1))
    assert not air.accepts(frame) and wire.accepts(frame)
    assert wire.signed(frame.raw) == frame.raw and len(air.signed(frame.raw)) == len(frame.raw) + 13


def framed(mav: Any, message: Any = BEAT) -> MavFrame:
    (frame,) = Framer().feed(bytes(message.pack(mav)))
    return frame


def signer(ticks: int, link_id: int = 0, system: int = 1) -> Any:
    mav = mavlink.MAVLink(None, system, 1)
    mav.signing.secret_key, mav.signing.sign_outgoing = KEY, True
    mav.signing.timestamp, mav.signing.link_id = ticks, link_id
    return mav


@given(st.data())
def test_no_changed_bit_passes_nor_leaves_a_trace(data: st.DataObject) -> None:
    frame, keyring = framed(signer(NOW)), Keyring(KEY, lambda: NOW_NS)
    at = data.draw(st.integers(10 * 8, len(frame.raw) * 8 - 1))  # the payload, checksum, link, time and hash
    raw = bytearray(frame.raw)
    raw[at // 8] ^= 1 << at % 8
    assert keyring.fault(MavFrame(bytes(raw), 2, 1, 1, frame.sequence, 0)) == "wrong_signature"
    assert keyring.fault(frame) is None and keyring.fault(frame) == "replayed"


def test_each_link_id_is_a_stream_of_its_own() -> None:
    keyring = Keyring(KEY, lambda: NOW_NS)
    assert keyring.fault(framed(signer(NOW + 500, 1))) is None
    assert keyring.fault(framed(signer(NOW, 2))) is None  # behind the other link, but within a minute
    assert keyring.fault(framed(signer(NOW + 400, 1))) == "replayed"
    assert keyring.fault(framed(signer(NOW - 61 * 100_000, 3))) == "too_old"


def test_a_clock_that_was_never_set_learns_the_autopilots_time() -> None:
    keyring = Keyring(KEY, lambda: 0)
    assert NOW > CLOCK_SET_TICKS and keyring.fault(framed(signer(NOW))) is None
    block = keyring.signature(b"frame", 0)
    assert int.from_bytes(block[1:7], "little") == NOW + 1
    assert keyring.fault(framed(signer(NOW - DAY, 5))) == "too_old"


def test_outgoing_times_rise_though_the_clock_stands_or_steps_back() -> None:
    clock = iter([NOW_NS, NOW_NS, NOW_NS - 10**15, NOW_NS + 10**9])
    keyring = Keyring(KEY, lambda: next(clock))
    times = [int.from_bytes(keyring.signature(b"x", 0)[1:7], "little") for _ in range(4)]
    assert times == [NOW, NOW + 1, NOW + 2, NOW + 100_000]


def test_a_clock_that_was_an_hour_on_locks_no_new_sender_out() -> None:
    clock = [NOW_NS]
    keyring = Keyring(KEY, lambda: clock[0])
    assert keyring.fault(framed(signer(NOW))) is None
    clock[0] += 3600 * 10**9
    ahead = int.from_bytes(keyring.signature(b"x", 0)[1:7], "little")
    assert ahead == NOW + 3600 * 100_000
    assert keyring.fault(framed(signer(NOW + 100, system=2))) == "too_old"
    clock[0] = NOW_NS
    assert keyring.fault(framed(signer(NOW + 100, system=2))) is None
    assert int.from_bytes(keyring.signature(b"x", 0)[1:7], "little") == ahead + 1


def test_senders_are_bounded() -> None:
    keyring = Keyring(KEY, lambda: NOW_NS)
    faults = [keyring.fault(framed(signer(NOW, system=1 + number))) for number in range(MOST_STREAMS + 1)]
    assert faults == [None] * MOST_STREAMS + ["too_many_senders"]
    assert keyring.fault(framed(signer(NOW + 1, system=1))) is None  # those known go on


def test_radio_status_needs_no_signature() -> None:
    keyring = Keyring(KEY, lambda: NOW_NS)
    radio = mavlink.MAVLink(None, 51, 68)
    assert keyring.fault(framed(radio, mavlink.MAVLink_radio_status_message(200, 190, 90, 40, 40, 0, 0))) is None
    assert keyring.fault(framed(radio)) == "unsigned"


def test_radio_status_makes_no_stranger_a_peer(key_file: str) -> None:
    async def body() -> None:
        async with running(signing_key=key_file) as app:
            with Sender(app, key=KEY) as honest, contextlib.ExitStack() as more:
                strangers = [more.enter_context(Sender(app)) for _ in range(MOST_PEERS)]
                sent = len(honest.heartbeat())
                await until(lambda: heard(app) == 1, "the true sender")
                radio = mavlink.MAVLink_radio_status_message(200, 190, 90, 40, 40, 0, 0)
                for stranger in strangers:
                    data = stranger.pack(radio)
                    stranger.send(data)
                    sent += len(data)
                await until(lambda: app.links[0].counters()["received_bytes"] == sent, "the radios' frames")
                honest.hear()
                await until(honest.hear, "what the service says: nobody took the true sender's place")
                assert [stranger.hear() for stranger in strangers] == [b""] * MOST_PEERS

    run(body())


@pytest.mark.parametrize(
    ("held", "mode", "names"),
    [
        (KEY, 0o644, "0644, must be 0600"),
        (KEY, 0o660, "0660, must be 0600"),
        (KEY[:31], 0o600, "32 bytes or 64 hex digits"),
        (b"a passphrase that someone thought would do", 0o600, "32 bytes or 64 hex digits"),
        (bytes(32), 0o600, "not all 0"),
        (b"", 0o600, "32 bytes"),
    ],
)
def test_a_bad_key_file_is_refused(tmp_path: Path, held: bytes, mode: int, names: str) -> None:
    path = tmp_path / "key"
    path.write_bytes(held)
    path.chmod(mode)
    with pytest.raises(ConfigError, match=names) as caught:
        signing_of_links(MavlinkConfig(signing_key=str(path)), time.time_ns)
    assert "\n" not in str(caught.value) and "mavlink.signing_key" in str(caught.value)
    assert KEY.hex() not in str(caught.value) and "passphrase" not in str(caught.value)


@pytest.mark.parametrize("name", ["key", "../key", "a/b", ""])
def test_a_credential_is_a_plain_name_in_systemds_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    (tmp_path / "credentials").mkdir()
    for path in (tmp_path / "key", tmp_path / "credentials" / "other"):
        path.write_bytes(KEY)
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(tmp_path / "credentials"))
    with pytest.raises(ConfigError, match="credential"):
        signing_of_links(MavlinkConfig(signing_key=f"credential:{name}"), time.time_ns)
    good = MavlinkConfig(signing_key="credential:other", links=(LinkConfig(url="udpin:127.0.0.1:0"),))
    assert signing_of_links(good, time.time_ns)[0].accepts(framed(signer(ticks_now())))
    monkeypatch.delenv("CREDENTIALS_DIRECTORY")
    with pytest.raises(ConfigError, match=r"CREDENTIALS_DIRECTORY is not set"):
        signing_of_links(good, time.time_ns)


def test_distloc_check_says_that_frames_were_refused(key_file: str) -> None:
    port = free_port(socket.SOCK_DGRAM)
    links = (LinkConfig(url=f"udpin:127.0.0.1:{port}"),)
    config = Config(mavlink=MavlinkConfig(links=links, signing_key=key_file))
    lines: list[str] = []

    async def body() -> None:
        checking = asyncio.create_task(run_check(config, lines.append, 1.0))
        beat = bytes(BEAT.pack(mavlink.MAVLink(None, 1, 1)))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot:
            while not checking.done():
                autopilot.sendto(beat, ("127.0.0.1", port))
                await asyncio.wait({checking}, timeout=0.1)
        assert not checking.result()

    run(body())
    said = [line for line in lines if "  link: " in line]
    assert [line[:4] for line in said] == ["fail", "warn"], lines
    assert "no frame that signing accepts" in said[0]
    assert re.search(r"frames refused by signing: \d+ unsigned; give the sender", said[1])


def test_distloc_check_hears_and_answers_a_signing_autopilot(key_file: str) -> None:
    port = free_port(socket.SOCK_DGRAM)
    links = (LinkConfig(url=f"udpin:127.0.0.1:{port}"),)
    config = Config(mavlink=MavlinkConfig(links=links, signing_key=key_file))
    mav = signer(ticks_now())
    findings: list[Finding] = []

    async def body() -> None:
        checking = asyncio.create_task(check_links(config, 1.5))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot:
            autopilot.setblocking(False)
            while not checking.done():
                autopilot.sendto(bytes(BEAT.pack(mav)), ("127.0.0.1", port))
                await asyncio.wait({checking}, timeout=0.1)
                with contextlib.suppress(BlockingIOError):
                    while True:
                        mav.parse_buffer(autopilot.recv(2048))
        findings.extend(checking.result())

    run(body())
    assert [str(one)[:10] for one in findings[:1]] == ["ok    link"] and "hears 1/1" in findings[0].said
    assert not any("refused" in one.said for one in findings)
    assert mav.signing.goodsig_count > 0 == mav.signing.badsig_count == mav.signing.unsigned_count
