"""What each command of `agvjax` does, from parsed arguments to a run folder."""


def __getattr__(name: str) -> object:
    from agvjax import _moved  # late: most imports ask for nothing that moved

    return _moved.find(__name__, name)
