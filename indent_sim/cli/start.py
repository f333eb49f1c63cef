"""Where the program starts: Ctrl-C while it loads ends it without a traceback.

Before `main` only what Python has loaded by itself is imported: whatever takes time is loaded once
a signal ends it.
"""

from __future__ import annotations

import gc
import os
import signal

# objects until the garbage collector looks for circles: loading makes many, and none to let go
GC_THRESHOLD = 50_000


def main() -> None:
    """Run the program as a console script."""
    gc.set_threshold(GC_THRESHOLD)
    os.environ.setdefault(
        "PYDANTIC_DISABLE_PLUGINS", "1"
    )  # for which it reads what is said of every installed package
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(
            signal.SIGINT, signal.SIG_DFL
        )  # until there is somebody to catch it: `Program.invoke`
    from indent_sim.process.quick_dataclasses import quick_dataclasses

    try:
        with quick_dataclasses():
            from indent_sim.cli.commands import main as run

            run()
    finally:
        gc.freeze()  # the process ends: what it has need not be searched for circles once more


if __name__ == "__main__":
    main()
