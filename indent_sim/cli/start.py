"""Entry point of the program: Ctrl-C while it loads ends it without a traceback.

The default handler of Ctrl-C is in place before any other module of the program is imported.
Nothing but the program may import this module, because it changes the handler of the process.
"""

import gc
import signal

if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    # `Program.invoke` sets a handler that raises KeyboardInterrupt, which it catches.
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def main() -> None:
    """Run the program as a console script."""
    from indent_sim.cli.commands import main as run_program

    try:
        run_program()
    finally:
        # The interpreter would search all objects of the libraries for garbage before it ends.
        gc.freeze()


if __name__ == "__main__":
    main()
