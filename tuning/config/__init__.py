"""Everything that can be set: settings, their names in TOML, how they are read, completed, checked and written."""

from .load import load as load
from .rules import check as check
from .settings import Config as Config
from .write import dump as dump
from .write import gains_table as gains_table


def __getattr__(name: str) -> object:
    from agvjax import _moved  # late: most imports ask for nothing that moved

    return _moved.find(__name__, name)
