"""Operates a server on the host it runs on: waits until it holds, executes, says how it ended."""
from __future__ import annotations

import sys

from gdmp_ros.errors import GdmpError
from gdmp_ros.ros.clients.server_client import Operator


def main(timeout: str) -> int:
    """Execute the loaded skill once, and say so: ``executing``, then ``ended with N``."""
    operator = Operator()
    try:
        operator.wait_status('holding', 120.0)
        operator.execute()
        print('executing', flush=True)
        result = operator.result(float(timeout))
        print(f'ended with {result.error_code} {result.error_string}', flush=True)
    except GdmpError as error:
        print(f'error: {error}', flush=True)
        return 1
    finally:
        operator.close()
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1]))
