"""The `agvjax` command: Ctrl-C ends it from its first line on, also inside the imports of what it needs."""

from .early import end_at_once


def run() -> None:
    """Run the command of this process's arguments."""
    end_at_once()
    from .main import run

    run()
