"""Who may open the page: only this machine's own pages, or who knows the token."""
from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import hmac
from http import HTTPStatus
from http.cookies import SimpleCookie
import secrets
from typing import Any
from urllib.parse import parse_qs, urlsplit

import websockets.asyncio.server
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from gdmp_ros.errors import GdmpError

#: Hosts that only this machine reaches.
LOOPBACK = ('127.0.0.1', 'localhost', '::1')
COOKIE = 'gdmp_studio'


class Access:
    """
    Checks requests.

    A web page elsewhere may not connect to a studio that the user has open: it could move a robot.

    :ivar token: that a browser has to know; empty on a loopback address, where none is needed
    """

    def __init__(self, host: str):
        """:param host: that the page is served at"""
        self._local, self._guarded = host in LOOPBACK, False
        self.token = '' if self._local else secrets.token_urlsafe(16)

    def check(self, request: Request) -> Response | None:
        """Answer to a request that is refused or redirected; None for one that is allowed."""
        headers = request.headers
        address = headers.get('Host', '')
        host = urlsplit(f'//{address}').hostname or ''
        if self._local and host not in LOOPBACK:
            return _answer(HTTPStatus.FORBIDDEN, f'{host} is not this machine')
        origin = headers.get('Origin')
        if origin is not None and urlsplit(origin).netloc != address:
            return _answer(HTTPStatus.FORBIDDEN, f'a page of {origin} may not connect')
        if not self.token:
            return None
        parts = urlsplit(request.path)
        if self._knows(parse_qs(parts.query).get('token', [''])[0]):
            return _answer(HTTPStatus.SEE_OTHER, '', {
                'Location': parts.path, 'Set-Cookie':
                f'{COOKIE}={self.token}; HttpOnly; SameSite=Strict; Path=/'})
        cookie = SimpleCookie(headers.get('Cookie', '')).get(COOKIE)
        if cookie is not None and self._knows(cookie.value):
            return None
        return _answer(HTTPStatus.UNAUTHORIZED, 'open the address that gdmp studio printed; it '
                                                'ends in ?token=…')

    def check_guarded(self) -> None:
        """:raises GdmpError: if no server was started in `guarding`: its requests go unchecked"""
        if not self._guarded:
            raise GdmpError('this version of viser starts its server in another way: its requests '
                            "cannot be checked; pip install 'viser>=1.1,<1.2'")

    def _knows(self, given: str) -> bool:
        return hmac.compare_digest(given.encode(), self.token.encode())

    @contextmanager
    def guarding(self) -> Iterator[None]:
        """Servers of websockets that are started meanwhile check their requests."""
        # viser has no place for a check of its requests; websockets has.
        module: Any = websockets.asyncio.server
        serve = module.serve

        def guarded(*args: Any, process_request: Callable[..., Any], **more: Any) -> Any:
            def process(connection: Any, request: Request) -> Any:
                refused = self.check(request)
                return process_request(connection, request) if refused is None else refused
            self._guarded = True
            return serve(*args, process_request=process, **more)
        module.serve = guarded
        try:
            yield
        finally:
            module.serve = serve


def _answer(status: HTTPStatus, text: str, more: dict[str, str] | None = None) -> Response:
    body = text.encode()
    headers = Headers({'Content-Type': 'text/plain; charset=utf-8', 'Connection': 'close',
                       'Content-Length': str(len(body)), **(more or {})})
    return Response(status.value, status.phrase, headers, body)
