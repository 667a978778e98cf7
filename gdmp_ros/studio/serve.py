"""Starts the studio: page, robot and workbench, until Ctrl-C."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import errno
from pathlib import Path
import socket
import threading
import webbrowser

import viser

from gdmp_ros.errors import DataError
from gdmp_ros.studio.access import Access
from gdmp_ros.studio.app import Studio
from gdmp_ros.studio.correct_panel import CorrectPanel
from gdmp_ros.studio.robot import Robot
from gdmp_ros.studio.run_panel import RunPanel, TimePanel
from gdmp_ros.studio.sequence_panel import SequencePanel
from gdmp_ros.studio.skill_panel import SkillPanel
from gdmp_ros.studio.teach_panel import TeachPanel
from gdmp_ros.studio.workbench import Workbench
from gdmp_ros.util.signals import stop_event

#: First port that is tried.
PORT = 8080
#: Addresses that stand for all of a machine.
EVERYWHERE = ('0.0.0.0', '::')
#: Ports that are tried if none is asked for.
_TRIED = 100


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
                    raise DataError(f'--host {host}, port {candidate}: {reason}') from None
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
    gui.configure_theme(show_logo=False, show_share_button=False, control_width='large')
    gui.set_panel_label(f'gdmp studio: {studio.robot.name}')
    tabs = gui.add_tab_group()
    with tabs.add_tab('skill'):
        SkillPanel(studio)
    with tabs.add_tab('run'):
        run = RunPanel(studio)
        with gui.add_folder('correct by hand', expand_by_default=False):
            correct = CorrectPanel(studio, run)
    if studio.bench.sequences:
        with tabs.add_tab('sequence'):
            SequencePanel(studio)
    with tabs.add_tab('teach'):
        teach = TeachPanel(studio)
    for panel in (teach, correct):
        server.on_client_disconnect(lambda _, panel=panel: studio.jobs.put(panel.release))
    with gui.add_folder('time'):
        TimePanel(studio)


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
