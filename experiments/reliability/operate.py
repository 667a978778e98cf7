"""Executes the skill of a server until its goal is reached, on the host of the server."""
from __future__ import annotations

from collections.abc import Callable
import sys

from gdmp_ros.errors import GdmpError
from gdmp_ros.ros.clients.server_client import ServerClient

#: A robot that has been seen for this long is back: longer than a network is cut [s].
SETTLED_S = 3.0


def seen_for(client: ServerClient, seconds: float) -> Callable[[], bool]:
    """What tells whether the server has seen its robot for so long, from now on."""
    since = client.now()

    def seen() -> bool:
        nonlocal since
        if client.state is None or 'no_robot' in client.state.flags:
            since = client.now()
        return client.now() - since >= seconds
    return seen


def main(timeout: str) -> int:
    """Execute the loaded skill, at most twice; print ``executing``, then ``ended with N``."""
    client = ServerClient()
    try:
        client.wait_status('holding', 120.0)
        for last in (False, True):
            client.execute()
            print('executing', flush=True)
            result = client.result(float(timeout))
            print(f'ended with {result.error_code} {result.error_string}', flush=True)
            if last or result.error_code == result.SUCCESSFUL:
                break
            client.wait('the robot', seen_for(client, SETTLED_S), 60.0)
        print('done', flush=True)
    except GdmpError as error:
        print(f'error: {error}', flush=True)
        return 1
    finally:
        client.close()
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1]))
