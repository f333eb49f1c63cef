"""Entry point of the program, where Ctrl-C during imports causes no traceback.

The default handler of Ctrl-C is set before any other module of the program is imported. Other
programs must not import this module, because it changes the handler of the process.
"""

import signal

if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    # `Program.invoke` sets a handler that raises KeyboardInterrupt, which it catches.
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def main() -> None:
    """Run the program as a console script."""
    import gc

    from indent_sim.cli.commands import main as run_program

    try:
        run_program()
    finally:
        # Without this the interpreter would search all objects of the libraries for garbage before
        # it ends.
        gc.freeze()


if __name__ == "__main__":
    main()
