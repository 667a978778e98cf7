"""The executable ``gdmp``."""
from __future__ import annotations

import os
import signal


def main() -> int:
    """Import the command and run a verb; Ctrl-C during the import leaves no traceback."""
    # A shell starts background jobs with SIGINT ignored: this is left as it is.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    if '_ARGCOMPLETE' in os.environ:
        from gdmp_ros.cli.completion import complete
        complete()
    from gdmp_ros.cli.main import main as run
    return run()


if __name__ == '__main__':
    raise SystemExit(main())
