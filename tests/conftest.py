"""Settings shared by all tests."""

from __future__ import annotations

import signal

import hypothesis
from threadpoolctl import threadpool_limits

hypothesis.settings.register_profile("dynhair", deadline=None, derandomize=True, max_examples=25)
hypothesis.settings.load_profile("dynhair")

# BLAS's threads spin: on the small matrices here they cost minutes where other processes run.
threadpool_limits(1, user_api="blas")

# A shell's background jobs, and whatever they start, are begun to ignore Ctrl-C, by which tests stop themselves.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
