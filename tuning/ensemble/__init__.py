"""The scenarios to tune for: distributions, samples, and the worst of a box."""


def __getattr__(name: str) -> object:
    from agvjax import _moved  # late: most imports ask for nothing that moved

    return _moved.find(__name__, name)
