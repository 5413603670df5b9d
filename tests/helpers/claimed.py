"""What the reports claim, as words: which of them do not say what kind of claim they are."""

import re

from agvjax.metric_table import METRICS

MEANT = "What the words mean: "  # how a report's own line begins
# a statistic of a goal or a limit is called as its key is, with the metric after it: `worst total_rmse`
FORMS = [" found", r" of (?:\d|\{\})", r"\.json", r"\.png", " before a metric", *(rf" {name}\b" for name in METRICS)]
QUALIFIED = re.compile(rf"\b[Ww]orst(?={'|'.join(FORMS)})")


def unqualified(text):
    """Words of a report that claim something and do not say which kind of claim it is."""
    return re.findall(r".{0,30}\bworst\b.{0,20}", QUALIFIED.sub("", text), re.I)


def meant(report):
    """The kinds of claim that a report says the meaning of: the names before the colons of its own line."""
    (line,) = [line for line in report.splitlines() if line.startswith(MEANT)]
    return [part.partition(":")[0] for part in line.removeprefix(MEANT).split("; ") if ":" in part]
