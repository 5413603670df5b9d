"""What the names in a report mean: gains by the docstrings of their laws, metrics by their table."""

from __future__ import annotations

from collections.abc import Sequence

import agvjax
from agvjax.leaves import element, get, metadata_of, stands_for
from agvjax.metric_table import METRICS

from ..config.described import meanings
from ..config.settings import Criteria


def of_gains(law: agvjax.Law, names: Sequence[str]) -> dict[str, str]:
    """By gain what it means, and its source in brackets; of a value of a schedule what it stands for."""
    return {name: _of_gain(law, name) for name in names}


def _of_gain(law: agvjax.Law, name: str) -> str:
    leaf, _ = element(stands_for(law, name))
    parent, _, last = leaf.rpartition(".")
    text = meanings(type(get(law, parent) if parent else law)).get(last, "")
    source = metadata_of(law, leaf).get("source", "")
    return f"{text} ({source})" if text and source and source not in text else text or source


def of_metrics(names: Sequence[str], criteria: Criteria) -> dict[str, str]:
    """By metric what it is, with the numbers of the `criteria`."""
    numbers = {"criteria.late": f"{criteria.late:g} s", "criteria.band": f"{criteria.band:g} m and rad"}
    texts = {name: METRICS[name].text for name in names}
    for key, number in numbers.items():
        texts = {name: text.replace(key, number) for name, text in texts.items()}
    return texts
