"""A server of the protocol as a process."""
import socket
import time

from gdmp_ros.franka.protocol_server import PORT
from gdmp_ros.util.processes import ChildProcesses

NAME = 'protocol_server'


class Server:
    """Starts, kills and starts again."""

    def __init__(self, folder, environment):
        self.children = ChildProcesses(environment, folder)

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        self.children.stop_all()

    def start(self, *arguments):
        self.children.start(NAME, 'gdmp_ros.franka.protocol_server', arguments)
        ends = time.monotonic() + 30.0
        while True:
            self.children.check()
            with socket.socket() as probe:
                if probe.connect_ex(('127.0.0.1', PORT)) == 0:
                    break
            assert time.monotonic() < ends, self.log()
            time.sleep(0.1)
        time.sleep(1.5)  # it takes one client, and has to see the end of this one

    def kill(self):
        self.children.kill(NAME)

    def log(self):
        return self.children.log(NAME).read_text()
