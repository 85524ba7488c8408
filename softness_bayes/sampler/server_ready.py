"""End of the initialisation of the server: it no longer looks for its parent, as its connection now ends with it."""

from __future__ import annotations

import signal

from softness_bayes.sampler.server import SERVING

if SERVING:
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
