"""Entry point of the program: Ctrl-C while it loads ends it without a traceback.

Before `main` only modules are imported that Python has loaded by itself; all others are imported
when the default handler of Ctrl-C is in place.
"""

from __future__ import annotations

import gc
import signal


def main() -> None:
    """Run the program as a console script."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        # `Program.invoke` sets a handler that raises KeyboardInterrupt, which it catches.
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from indent_sim.cli.commands import main as run_program

    try:
        run_program()
    finally:
        # The interpreter would search all objects of the libraries for garbage before it ends.
        gc.freeze()


if __name__ == "__main__":
    main()
