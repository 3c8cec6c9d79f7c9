"""Workers do not hear Ctrl-C; whoever started them does."""

import signal
import subprocess
import sys

import pytest

from mixpinn.dataset.local_pool import deaf_to_interrupts

SAYS = "import signal; print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))"


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="no signal masks here")
def test_children_do_not_hear_the_interrupt_and_the_parent_does():
    with deaf_to_interrupts():
        child = subprocess.run([sys.executable, "-c", SAYS], capture_output=True, text=True, check=True)
    assert child.stdout.strip() == "True"
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])
