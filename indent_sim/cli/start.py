"""Entry point of the program: Ctrl-C while it loads ends it without a traceback.

The default handler of Ctrl-C is in place before any other module is imported, even of the standard
library. Nothing but the program may import this module, because it changes the handler of the
process.
"""

import _signal  # `signal` would import `enum` first

if _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler:
    # `Program.invoke` sets a handler that raises KeyboardInterrupt, which it catches.
    _signal.signal(_signal.SIGINT, _signal.SIG_DFL)

import gc
import os

# Number of new objects after which the garbage collector searches for cycles. Imports create many
# objects and no garbage; the default of 700 would search them many times.
GC_THRESHOLD = 50_000


def main() -> None:
    """Run the program as a console script."""
    gc.set_threshold(GC_THRESHOLD)
    # Pydantic would read the metadata of every installed package to find plugins.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "1")
    from indent_sim.process.quick_dataclasses import quick_dataclasses

    try:
        with quick_dataclasses():
            from indent_sim.cli.commands import main as run_program

            run_program()
    finally:
        # The process ends: a last search for cycles in its objects would free nothing of use.
        gc.freeze()


if __name__ == "__main__":
    main()
