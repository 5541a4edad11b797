"""Who may see the picture: the address asked for, the origin, the token; and what a page of ours may do."""

import hmac
from collections.abc import Awaitable, Callable
from urllib.parse import SplitResult, urlsplit

from aiohttp import web

COOKIE = "distloc_token"
_LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})
_POLICY = "Content-Security-Policy"
HEADERS = {
    _POLICY: "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=()",
    "Cache-Control": "no-store",
    "Server": "distloc",  # and not which versions it is made of
}
_Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


def is_loopback(host: str) -> bool:
    """Whether only this computer can reach it."""
    return host in _LOOPBACK


class Access:
    """Refuses what may not be: another host or origin, and without the token where there is one.

    The page may show images of `image_origin` as well, a tile server that the operator named.
    """

    def __init__(self, token: str, image_origin: str = "") -> None:
        self._token = token
        policy = HEADERS[_POLICY].replace("img-src 'self'", f"img-src 'self' {image_origin}".rstrip())
        self._headers = HEADERS | {_POLICY: policy}

    def refusal(self, request: web.Request) -> str | None:
        """Why not; None where it may be."""
        host = request.headers.get("Host", "")
        if not self._token and not is_loopback(_parts(f"//{host}").hostname or ""):
            return "open it as http://127.0.0.1"  # another name that leads here: rebinding
        origin = request.headers.get("Origin")
        if origin is not None and (_parts(origin).netloc or None) != host:
            return "asked for by a page of another origin"
        if request.headers.get("Sec-Fetch-Site", "none") == "cross-site" and request.path != "/":
            return "asked for by a page of another site"
        if self._token and not any(map(self._is_token, _given(request))):
            return "open the address with the token, as distloc ground printed it"
        return None

    def _is_token(self, given: str) -> bool:
        return hmac.compare_digest(given.encode("ascii", "replace"), self._token.encode())  # no token has a "?"

    def welcome(self, request: web.Request) -> web.Response | None:
        """The page's address with the right token: the token becomes a cookie and leaves the address."""
        given = request.query.get("token")
        if request.path != "/" or given is None or not self._token or not self._is_token(given):
            return None
        answer = web.Response(status=303, headers={"Location": "/"})
        answer.set_cookie(COOKIE, self._token, httponly=True, samesite="Strict", path="/")
        return answer

    @web.middleware
    async def guard(self, request: web.Request, handler: _Handler) -> web.StreamResponse:
        """On every request; its headers on every answer."""
        response: web.StreamResponse | None = self.welcome(request)
        if response is None:
            refusal = self.refusal(request)
            if refusal is not None:
                response = web.Response(status=403, text=refusal + "\n")
            else:
                try:
                    response = await handler(request)
                except web.HTTPException as error:
                    response = web.Response(status=error.status, text=f"{error.status} {error.reason}\n")
        if not response.prepared:
            response.headers.update(self._headers)
        return response


def _given(request: web.Request) -> tuple[str, str]:
    """The token as a browser keeps it, and as a program sends it: `Authorization: Bearer TOKEN`."""
    kind, _, bearer = request.headers.get("Authorization", "").partition(" ")
    return request.cookies.get(COOKIE, ""), bearer.strip() if kind.lower() == "bearer" else ""


def _parts(address: str) -> SplitResult:
    """Of any text; empty where it is no address."""
    try:
        return urlsplit(address)
    except ValueError:
        return urlsplit("")
