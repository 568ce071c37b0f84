"""What holds for all tests: Ctrl-C is possible."""

import signal


def pytest_configure(config):
    # a script that starts the tests by `&` ignores it, which all processes of tests would inherit
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
