"""Where the program starts: Ctrl-C while it loads ends it without a traceback."""

from __future__ import annotations

import signal


def main() -> None:
    """The console script."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # until there is somebody to catch it: `Program.invoke`
    from indent_sim.cli.commands import main as run

    run()


if __name__ == "__main__":
    main()
