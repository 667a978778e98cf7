"""A server of the protocol as a process, on this machine or behind a cable that can be cut."""
from datetime import datetime
import os
import subprocess

from gdmp_ros.franka.protocol_server import await_server, HOST
from gdmp_ros.util.processes import ChildProcesses

NAME = 'protocol_server'


class Server:
    """Starts, kills and starts again."""

    def __init__(self, folder, environment, host=HOST, prefix=(), arguments=()):
        self.children = ChildProcesses(environment, folder)
        self.host, self._prefix, self._arguments = host, prefix, arguments

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        self.children.stop_all()

    def start(self):
        self.children.start(NAME, 'gdmp_ros.franka.protocol_server', self._arguments, self._prefix)
        await_server(self.children.check, self.host)

    def kill(self):
        self.children.kill(NAME)

    def log(self):
        return self.children.log(NAME).read_text()

    def aborted(self):
        """Why it has ended motions, as the robot would."""
        return [line.split('ERROR')[-1] for line in self.log().splitlines()
                if 'aborting the motion' in line]

    def silent_at(self):
        """When it has ended motions because commands did not arrive [s, wall time]."""
        return [datetime.strptime(line[:23], '%Y-%m-%d %H:%M:%S,%f').timestamp()
                for line in self.log().splitlines()
                if 'communication_constraints_violation' in line and 'aborting the motion' in line]


class Cable:
    """A network namespace for the robot, and a virtual cable to it; needs the rights of root."""

    def __init__(self):
        self.namespace, self.end = f'gdmp-{os.getpid()}-franka', f'gf{os.getpid() % 100000}'
        self.host = '10.93.8.2'
        self.prefix = ['nsenter', f'--net=/run/netns/{self.namespace}']

    def __enter__(self):
        inside, name = f'{self.end}i', self.namespace
        _ip('netns', 'add', name)
        _ip('link', 'add', self.end, 'type', 'veth', 'peer', 'name', inside, 'netns', name)
        _ip('addr', 'add', '10.93.8.1/24', 'dev', self.end)
        _ip('link', 'set', self.end, 'up')
        for words in (('link', 'set', 'lo', 'up'), ('link', 'set', inside, 'up'),
                      ('addr', 'add', f'{self.host}/24', 'dev', inside)):
            _ip('-n', name, *words)
        return self

    def __exit__(self, *_):
        subprocess.run(['ip', 'netns', 'del', self.namespace], capture_output=True)
        subprocess.run(['ip', 'link', 'del', self.end], capture_output=True)

    def cut(self):
        # At the end of the robot: this machine goes on to send there.
        _ip('-n', self.namespace, 'link', 'set', f'{self.end}i', 'down')

    def join(self):
        _ip('-n', self.namespace, 'link', 'set', f'{self.end}i', 'up')


def _ip(*words):
    subprocess.run(['ip', *words], check=True, capture_output=True, text=True)
