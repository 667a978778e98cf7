"""The studio in lockstep: its panels as a user sees and uses them, without a browser."""
import asyncio
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import viser

from gdmp_ros.studio.app import Studio
from gdmp_ros.studio.serve import page_of
from gdmp_ros.studio.simulated_robot import SimulatedRobot
from gdmp_ros.studio.workbench import opened
from test.lockstep.clock import SteppedClock

LOOK_NS, NS = 50_000_000, 1_000_000_000
#: Number of the user's browser.
USER = 1


class LockstepPage:
    """
    Texts, fields and handles of the page.

    :ivar told: notifications
    """

    def __init__(self, studio):
        self.studio, self.told = studio, []
        studio.notify = lambda title, text, paint='': self.told.append(f'{title}: {text}')
        page_of(studio)
        self._running = studio.clock.start(studio.steps())
        self.spend(0.1)

    def spend(self, seconds):
        clock = self.studio.clock
        clock.run_until(clock.now() + round(NS * seconds))
        if self._running.failure is not None:
            raise self._running.failure

    def _parts(self, container=None):
        """Everything in the panel, in its order."""
        root = self.studio.server.gui._container_handle_from_uuid['root']
        for part in list((container or root)._children.values()):
            yield part
            for inner in [part, *getattr(part, '_tab_handles', ())]:
                if hasattr(inner, '_children'):
                    yield from self._parts(inner)

    def text(self):
        """All text of the page."""
        return '\n'.join([*(
            f'{getattr(part, "label", "")} {getattr(part, "content", "")}'.strip()
            for part in self._parts()), *self.told])

    def wait(self, what, until, timeout=30.0):
        """Let time pass until a condition of the page's text holds; returns what it returned."""
        clock = self.studio.clock
        ends = clock.now() + NS * timeout
        while True:
            text = self.text()
            found = until(text)
            if found is not None and found is not False:
                return found
            assert clock.now() < ends, f'{what}:\n{text}'
            self.spend(LOOK_NS / NS)

    def wait_text(self, text):
        self.wait(text, lambda all_text: text in all_text)

    def part(self, label):
        """The part with a label, or the text field with a content."""
        return next(part for part in self._parts()
                    if getattr(part, 'label', None) == label or (
                        isinstance(part, viser.GuiTextHandle) and part.value == label))

    def use(self, part):
        """What the page's server does when a user has changed a field; no time passes."""
        event = SimpleNamespace(client_id=USER, target=part)
        for callback in part._impl.update_cb:
            asyncio.run(callback(event))

    def click(self, button):
        self.use(self.part(button))
        self.spend(0.01)

    def click_at(self, name):
        """Click at the mark of something in space."""
        for entry in self.studio.scene._marks[name]._impl.click_cb:
            asyncio.run(entry.callback(SimpleNamespace(client_id=USER)))
        self.spend(0.01)

    def enter(self, label, value):
        """Type, choose, tick or slide."""
        part = self.part(label)
        part.value = value
        self.use(part)
        self.spend(0.01)

    def close(self):
        """Close the browser."""
        for disconnected in self.studio.server._client_disconnect_cb:
            disconnected(None)

    def position(self, name):
        """Of a handle in space [m]."""
        return np.array(self.studio.scene._handles[name][0].position)

    def drag(self, name, away, steps=10, held=0.0):
        """Drag a handle by a displacement [m], and hold it there [s]; select it first."""
        if name in self.studio.scene.marks() and name not in self.studio.scene.handles(''):
            self.enter('move with the handle', name)
        begun = self.position(name)
        for step in range(1, steps + 1):
            self.move(name, begun + np.multiply(step / steps, away), 'update')
            self.spend(0.06)
        self.spend(held)
        self.move(name, begun + away, 'end')

    def move(self, name, position, phase):
        """What the page's server does when a user drags a handle; no time passes."""
        handle = self.studio.scene._handles[name][0]
        target = SimpleNamespace(position=position, wxyz=np.array(handle.wxyz))
        handle._impl.position = position
        for callback in handle._impl_aux.update_cb:
            asyncio.run(callback(SimpleNamespace(target=target, phase=phase)))


@contextmanager
def opened_page(folder, *sources):
    """The studio with these files, and takes in the folder ``takes``."""
    clock = SteppedClock()
    robot = SimulatedRobot(clock=clock)
    server = viser.ViserServer('127.0.0.1', 0, verbose=False)
    try:
        bench = opened([folder / source for source in sources])
        yield LockstepPage(Studio(server, bench, robot, '', folder / 'takes', clock))
    finally:
        server.stop()
        robot.close()
