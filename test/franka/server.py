"""A server of the protocol as a process."""
from gdmp_ros.franka.protocol_server import await_server
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
        await_server(self.children.check)

    def kill(self):
        self.children.kill(NAME)

    def log(self):
        return self.children.log(NAME).read_text()
