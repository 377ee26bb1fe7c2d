"""Decides who may use the server: by host name, origin and token.

A page on the web must not reach a server on this machine through the operator's own browser: neither by a host name of
its own that points here (DNS rebinding: the Host header), nor by a socket or form of its own (the Origin header). If
the server listens on an address that other machines can reach, a token is also required.
"""

import ipaddress
import secrets
from collections.abc import Iterable
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs, urlsplit

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketClose

POLICY_VIOLATION = 1008
"""WebSocket close code: policy violation."""


class Guard:
    """ASGI middleware that checks every request.

    Args:
        app: application that is protected.
        names: host names of this server besides ``localhost``. A numeric address is always accepted, because nobody
            else can bind a name to it.
        token: required from every request, in the query or the cookie; None: no token is required.
        cookie: name of the cookie; other servers on this machine use other names.
    """

    def __init__(self, app: ASGIApp, names: Iterable[str], token: str | None, cookie: str) -> None:
        self._app, self._token, self._cookie = app, token, cookie
        self._names = {"localhost", *(name.lower() for name in names)}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        shown = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        refusal: Response | None = None
        if not self._known(host):
            refusal = PlainTextResponse("this server does not have that name; use its numeric address", 421)
        elif not self._own_origin(scope, headers, host):
            refusal = PlainTextResponse("requests from other pages are refused", 403)
        elif not (self._right(shown) or self._right(self._cookie_of(headers))):
            refusal = PlainTextResponse("the token is missing or wrong: open the address that the program printed", 403)
        elif shown and scope["type"] == "http" and scope["path"] == "/" and self._token is not None:
            refusal = RedirectResponse("/", 303)  # removes the token from the address line and from the history
            refusal.set_cookie(self._cookie, self._token, httponly=True, samesite="lax")
        if scope["type"] == "websocket":
            await (self._app if refusal is None else WebSocketClose(POLICY_VIOLATION))(scope, receive, send)
            return

        async def hardened(message: Message) -> None:
            if message["type"] == "http.response.start":
                message = {**message, "headers": [*message["headers"], *_security_headers(host)]}
            await send(message)

        await (self._app if refusal is None else refusal)(scope, receive, hardened)

    def _known(self, host: str) -> bool:
        name = _host_name(host)
        if name is None:
            return False
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return name in self._names
        return True

    @staticmethod
    def _own_origin(scope: Scope, headers: Headers, host: str) -> bool:
        """Returns whether the origin is this server.

        Browsers state the origin on sockets and changing requests; programs do not.
        """
        origin = headers.get("origin")
        harmless = scope["type"] == "http" and scope["method"] in ("GET", "HEAD")
        if origin is None or harmless:
            return True
        parts = urlsplit(origin)
        return parts.scheme in ("http", "https") and parts.netloc.lower() == host.lower()

    def _right(self, shown: str) -> bool:
        return self._token is None or secrets.compare_digest(shown.encode(), self._token.encode())

    def _cookie_of(self, headers: Headers) -> str:
        cookies: SimpleCookie = SimpleCookie()
        try:
            cookies.load(headers.get("cookie", ""))
        except CookieError:
            return ""
        found = cookies.get(self._cookie)
        return "" if found is None else found.value


def _host_name(host: str) -> str | None:
    """Returns the name or address in a Host header, without its port; None if the header is not valid.

    >>> _host_name("[::1]:8000"), _host_name("A.local"), _host_name("x y"), _host_name("a@b")
    ('::1', 'a.local', None, None)
    """
    if not (host and host.isascii()) or not all(letter.isalnum() or letter in ".-_:[]" for letter in host):
        return None
    try:
        parts = urlsplit(f"//{host}")
        _ = parts.port  # raises if it is not a number
    except ValueError:
        return None
    return parts.hostname


def _security_headers(host: str) -> list[tuple[bytes, bytes]]:
    """Returns headers that forbid foreign content, inline scripts and frames; ``host`` is left out if not valid."""
    # Older Safari does not count a socket to the same host as "self".
    sockets = f" ws://{host} wss://{host}" if _host_name(host) else ""
    policy = (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; "
        f"connect-src 'self'{sockets}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    named = {
        "content-security-policy": policy,
        "cross-origin-opener-policy": "same-origin",
        "cross-origin-resource-policy": "same-origin",
        "referrer-policy": "no-referrer",
        "x-content-type-options": "nosniff",
        "x-frame-options": "DENY",
        "cache-control": "no-store",
        "permissions-policy": "camera=(), microphone=(), geolocation=()",
    }
    return [(name.encode(), value.encode("latin-1")) for name, value in named.items()]
