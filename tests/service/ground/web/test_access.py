"""Who may see the picture: tokens, origins, hosts, paths; by real requests to the real server."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager

import aiohttp
import pytest
from aiohttp import web

from service.ground.background.backdrop import Backdrop
from service.ground.web.access import Access
from service.ground.web.hub import MOST_WATCHERS, MOST_WORD_BYTES, Hub
from service.ground.web.site import served as on_sockets
from service.ground.web.site import site

TOKEN = "a-token-of-ours-1234"


@asynccontextmanager
async def served(token: str, words: list[str]) -> AsyncIterator[tuple[aiohttp.ClientSession, str]]:
    hub = Hub(lambda _: '{"kind":"all"}', words.append)
    pictures = {"drone1": b"\xff\xd8\xffpicture"}
    ours = site(
        Access(token),
        hub,
        pictures.get,
        lambda at: f'{{"at":{at}}}'.encode(),
        Backdrop(),
        lambda body: None if body == b"{}" else "not readable",
    )
    runner = on_sockets(ours, 1.0)
    await runner.setup()
    try:
        await web.TCPSite(runner, "127.0.0.1", 0).start()
        async with aiohttp.ClientSession(cookie_jar=aiohttp.CookieJar(unsafe=True)) as session:
            yield session, f"http://127.0.0.1:{runner.addresses[0][1]}"
    finally:
        await hub.close()
        await runner.cleanup()


def asked(check: Callable[[aiohttp.ClientSession, str], Awaitable[None]], token: str = "") -> list[str]:
    """Run a check against a server; what its pages said."""
    words: list[str] = []

    async def run() -> None:
        async with served(token, words) as (session, address):
            await check(session, address)

    asyncio.run(run())
    return words


async def status(session: aiohttp.ClientSession, url: str, **headers: str) -> int:
    names = {name.replace("_", "-"): value for name, value in headers.items()}
    async with session.get(url, headers=names, allow_redirects=False) as answer:
        return answer.status


PATHS = [
    *("/", "/main.js", "/live", "/past?t=1", "/preview?vehicle=drone1", "/meanings"),
    *("/background", "/places", "/tiles/1/0/0", "/nothing"),
]


@pytest.mark.parametrize("path", PATHS)
def test_without_the_token_or_with_another_nothing_is_told(path: str) -> None:
    async def check(session: aiohttp.ClientSession, address: str) -> None:
        assert await status(session, address + path) == 403
        assert await status(session, address + path, Cookie="distloc_token=a-token-of-ours-1235") == 403
        assert await status(session, f"{address}/?token=wrong") == 403
        assert await status(session, f"{address}/?token=%C3%A4") == 403

    asked(check, TOKEN)


def test_the_address_with_the_token_opens_all_and_leaves_the_token_in_no_address() -> None:
    async def check(session: aiohttp.ClientSession, address: str) -> None:
        async with session.get(f"{address}/?token={TOKEN}") as answer:
            assert answer.status == 200 and str(answer.url) == f"{address}/"
            cookie = answer.history[0].headers["Set-Cookie"]
            assert "HttpOnly" in cookie and "SameSite=Strict" in cookie
        assert await status(session, f"{address}/main.js") == 200
        async with session.ws_connect(f"{address}/live") as live:
            assert (await live.receive()).data == '{"kind":"all"}'

    asked(check, TOKEN)


@pytest.mark.parametrize("path", PATHS)
def test_another_origin_site_or_host_is_refused(path: str) -> None:
    async def check(session: aiohttp.ClientSession, address: str) -> None:
        assert await status(session, address + path, Origin="http://evil.example") == 403
        assert await status(session, address + path, Origin="null") == 403
        assert await status(session, address + path, Host="evil.example:8080") == 403  # rebinding
        if path != "/":
            assert await status(session, address + path, Sec_Fetch_Site="cross-site") == 403

    asked(check)


def test_a_page_of_another_origin_gets_no_live_channel_and_ours_does() -> None:
    async def check(session: aiohttp.ClientSession, address: str) -> None:
        with pytest.raises(aiohttp.WSServerHandshakeError, match="403"):
            await session.ws_connect(f"{address}/live", origin="http://127.0.0.1:1")
        async with session.ws_connect(f"{address}/live", origin=address) as live:
            assert (await live.receive()).data == '{"kind":"all"}'
            await live.send_str("word")

    assert asked(check) in (["word"], [])  # it may have ended before it was read


@pytest.mark.parametrize(
    "path",
    [
        "/../pyproject.toml",
        "/%2e%2e/web/site.py",
        "/leaflet/../../web/site.py",
        "//etc/passwd",
        "/index.html/",
        "/x" * 4000,
    ],
)
def test_no_path_leads_out_of_the_page(path: str) -> None:
    async def check(_session: aiohttp.ClientSession, address: str) -> None:
        host, _, port = address.removeprefix("http://").partition(":")
        reader, writer = await asyncio.open_connection(host, int(port))
        writer.write(f"GET {path} HTTP/1.1\r\nHost: {host}:{port}\r\nConnection: close\r\n\r\n".encode())
        answer = await reader.read()
        writer.close()
        assert answer.split()[1] in (b"404", b"400", b"414") and b"import" not in answer and b"root:" not in answer

    asked(check)


KEY = b"Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: \xff"
FOUL = [
    *(b"Host: [", b"Host: \xff\xfe", b"Host: [::1", b"Host: 127.0.0.1]:1", b"Origin: http://[", b"Origin: \xff\xfe"),
    *(b"Cookie: distloc_token=\xff\xfe", b"Cookie: \xff=\xfe;;;=", b"Expect: \xff", b"Content-Length: x", b"no colon"),
    *(b"Transfer-Encoding: \xff", b"Sec-Fetch-Site: \xff", b"X: " + b"y" * 10_000, KEY),
    KEY.replace(b"\xff", b"dGhlIHNhbXBsZSBub25jZQ==") + b"\r\nSec-WebSocket-Protocol: \xff",
]


@pytest.mark.parametrize("token", ["", TOKEN])
@pytest.mark.parametrize("path", [b"/", b"/live", b"/nothing", b"/\xff", b"/?token=%ed%a0%80", b"//["])
def test_headers_of_any_bytes_are_refused_and_leave_nothing_in_the_log(
    path: bytes, token: str, caplog: pytest.LogCaptureFixture
) -> None:
    async def check(_session: aiohttp.ClientSession, address: str) -> None:
        host, _, port = address.removeprefix("http://").partition(":")
        for header in FOUL:
            reader, writer = await asyncio.open_connection(host, int(port))
            named = b"" if header.startswith(b"Host") else f"Host: {host}:{port}\r\n".encode()
            writer.write(b"GET " + path + b" HTTP/1.1\r\n" + named + header + b"\r\n\r\n")
            status = int((await reader.readline()).split()[1])
            writer.close()
            assert status in ((400, 403) if token or b"Host" in header else (200, 400, 403, 404)), header

    with caplog.at_level("INFO"):
        asked(check, token)
    assert caplog.records == []


def test_every_answer_forbids_what_is_not_ours() -> None:
    async def check(session: aiohttp.ClientSession, address: str) -> None:
        for path in ("/", "/main.js", "/nothing", "/preview?vehicle=drone1", "/preview?vehicle=../x", "/past?t=x"):
            async with session.get(address + path) as answer:
                policy = answer.headers["Content-Security-Policy"]
                assert policy.startswith("default-src 'none'") and "unsafe" not in policy and "http" not in policy
                assert answer.headers["X-Content-Type-Options"] == "nosniff"
                assert answer.headers["Server"] == "distloc"

    asked(check)


def test_watchers_are_bounded_and_a_long_word_ends_its_channel() -> None:
    async def check(session: aiohttp.ClientSession, address: str) -> None:
        live = [await session.ws_connect(f"{address}/live") for _ in range(MOST_WATCHERS)]
        assert await status(session, f"{address}/live") == 503
        await live[0].receive()
        await live[0].send_str("x" * (MOST_WORD_BYTES + 1))
        assert (await live[0].receive()).type in (aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED)
        for one in live:
            await one.close()

    assert asked(check) == []
