"""Entry point of the program: Ctrl-C while it loads ends it without a traceback.

Before `main` only modules are imported that Python has loaded by itself; all others are imported
when the default handler of Ctrl-C is in place.
"""

from __future__ import annotations

import gc
import os
import signal

# Number of new objects after which the garbage collector searches for cycles. Imports create many
# objects and no garbage; the default of 700 would search them many times.
GC_THRESHOLD = 50_000


def main() -> None:
    """Run the program as a console script."""
    gc.set_threshold(GC_THRESHOLD)
    # Pydantic would read the metadata of every installed package to find plugins.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "1")
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        # `Program.invoke` sets a handler that raises KeyboardInterrupt, which it catches.
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        from indent_sim.cli.commands import main as run_program

        run_program()
    finally:
        # The process ends: a last search for cycles in its objects would free nothing of use.
        gc.freeze()


if __name__ == "__main__":
    main()
