"""Jobs that processes of their own are sent by name."""

import os
import signal

import jax


def squares(about):
    """What makes the squares of numbers beyond `about`."""

    def make(number):
        if number == 13:
            raise ValueError("thirteen is not computed")
        return f"{about + number**2} {jax.numpy.float64(1.0).dtype}".encode()

    return make


def deadly(about):
    """What ends its process at every number but one."""

    def make(number):
        if number == about:
            return b"alive"
        os.kill(os.getpid(), signal.SIGKILL)
        return b""

    return make
