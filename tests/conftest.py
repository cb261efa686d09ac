"""What every test may rely on, however the tests were started."""

import signal

# A shell starts what runs in its background with SIGINT ignored; so would all children be, and
# those of bash could not even ask for it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
