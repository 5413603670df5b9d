"""What stands between a command and what is delivered: the deadzone, and elements in any order as a chain."""

from .. import _moved


def __getattr__(name: str) -> object:
    return _moved.find(__name__, name)
