"""Starts the studio: page, robot and workbench, until Ctrl-C; who may open the page."""
from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
import errno
import hmac
from http import HTTPStatus
from http.cookies import SimpleCookie
from pathlib import Path
import secrets
import socket
import threading
from typing import Any
from urllib.parse import parse_qs, urlsplit
import webbrowser

import viser
import websockets.asyncio.server
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.studio.app import Studio
from gdmp_ros.studio.robot import Robot
from gdmp_ros.studio.run_panel import RunPanel, SequencePanel, ViewPanel
from gdmp_ros.studio.scene_panel import ScenePanel
from gdmp_ros.studio.skill_panel import CorrectPanel, SkillPanel
from gdmp_ros.studio.teach_panel import TeachPanel
from gdmp_ros.studio.time_panel import TimePanel
from gdmp_ros.studio.workbench import Workbench
from gdmp_ros.util.processes import stop_event

#: Hosts that only this machine reaches.
LOOPBACK = ('127.0.0.1', 'localhost', '::1')
COOKIE = 'gdmp_studio'
#: First port that is tried.
PORT = 8080
#: Addresses that stand for all of a machine.
EVERYWHERE = ('0.0.0.0', '::')
#: Ports that are tried if none is asked for.
_TRIED = 100


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


@dataclass(frozen=True)
class StudioSettings:
    """
    How the page is served.

    :ivar host: address
    :ivar port: 0: the first free one from `PORT` on
    :ivar model: of the arm, as for ``panda_sim``
    :ivar takes: folder for takes
    :ivar browser: whether the page is opened in a browser
    """

    host: str = '127.0.0.1'
    port: int = 0
    model: str = ''
    takes: Path = Path('takes')
    browser: bool = True


def free_port(host: str, port: int) -> int:
    """
    A port that can be bound.

    :param port: that is wanted; 0 for any from `PORT` on
    :raises DataError: if there is none
    """
    reason = ''
    for candidate in [port] if port else range(PORT, PORT + _TRIED):
        with socket.socket(socket.AF_INET6 if ':' in host else socket.AF_INET) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((host, candidate))
                return candidate
            except OSError as error:
                reason = f'{error.strerror}'
                if error.errno != errno.EADDRINUSE:
                    raise DataError(f'--address {host}, port {candidate}: {reason}') from None
    raise DataError(f'{host}:{port or PORT}: {reason}; choose another one with --port')


def serve(bench: Workbench, settings: StudioSettings, make_robot: Callable[[], Robot]) -> None:
    """
    Show the studio until Ctrl-C or SIGTERM.

    :param make_robot: makes the robot that is shown
    :raises GdmpError: if the port is taken, or the robot cannot be made
    """
    port, access = free_port(settings.host, settings.port), Access(settings.host)
    ends = stop_event()
    robot = make_robot()
    try:
        with access.guarding():
            server = viser.ViserServer(settings.host, port, label='gdmp studio', verbose=False)
        try:
            access.check_guarded()
            _show(server, bench, robot, settings, access, ends)
        finally:
            server.stop()
    finally:
        robot.close()
    print('ended')


def page_of(studio: Studio) -> None:
    """Lay out the panels."""
    server, gui = studio.server, studio.server.gui
    # The panel stands beside the picture, and folds.
    gui.configure_theme(show_logo=False, show_share_button=False, control_width='large')
    gui.main_panel.dock_right()
    gui.set_panel_label(f'gdmp studio: {studio.robot.name}')
    tabs = gui.add_tab_group()
    with tabs.add_tab('skill'):
        SkillPanel(studio)
    with tabs.add_tab('run'):
        run = RunPanel(studio)
        with gui.add_folder('correct by hand', expand_by_default=False):
            correct = CorrectPanel(studio, run)
    shown: list[SequencePanel] = []

    def show_sequences() -> None:
        if shown:
            shown[0].update()
        elif studio.bench.sequences:
            with tabs.add_tab('sequence'):
                shown.append(SequencePanel(studio))
    show_sequences()
    studio.on_opened.append(show_sequences)
    with tabs.add_tab('teach'):
        teach = TeachPanel(studio)
    with tabs.add_tab('surroundings'):
        ScenePanel(studio)
    for panel in (teach, correct):
        server.on_client_disconnect(lambda _, panel=panel: studio.jobs.put(panel.release))
    with gui.add_folder('time'):
        TimePanel(studio)
    with gui.add_folder('view', expand_by_default=False):
        ViewPanel(studio)


def _show(server: viser.ViserServer, bench: Workbench, robot: Robot, settings: StudioSettings,
          access: Access, ends: threading.Event) -> None:
    studio = Studio(server, bench, robot, settings.model, settings.takes)
    page_of(studio)
    name = socket.gethostname() if settings.host in EVERYWHERE else settings.host
    host = f'[{name}]' if ':' in name else name
    address = f'http://{host}:{server.get_port()}/' + (
        f'?token={access.token}' if access.token else '')
    print(f'studio: {address}  (Ctrl-C ends it)', flush=True)
    if settings.browser:
        webbrowser.open(address)
    studio.run(ends)
