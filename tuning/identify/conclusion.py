"""What numbers from a log are good for, in one sentence: what they tell, what they miss, and beside plain models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from .fit import Fit
from .log import Log
from .predict import Prediction
from .segments import noise
from .verdict import Estimate, FitVerdict

LOST = 0.1  # share of outliers beyond which a fit is one of the rest alone
BETTER = 0.9  # times the error of a plain model, at most, of what explains more than it
LACKING = 2 / 3  # the same of what is known to lack something: its numbers are then means of what they stand for
CLOSE = 2.0  # times the noise of what is measured: a prediction as good as one can see
KINDS = {  # of numbers, by how their names begin and end
    "deadzones": ("deadzone.", ""),
    "delays": ("actuators.", ".time"),
    "lags": ("actuators.", ".time_constant"),
    "actuators": ("actuators.", ""),
    "pushes": ("disturbance.", ""),
    "the vehicle": ("plant.", ""),
    "the sensor": ("sensor.", ""),
}


class Conclusion(NamedTuple):
    """What numbers are good for."""

    good: bool  # for anything
    text: str  # a sentence, and how well another drive, or the same, is predicted


def conclude(logs: Sequence[Log], fit: Fit, verdict: FitVerdict, ahead: Sequence[Prediction], own: bool) -> Conclusion:
    """The sentence.

    Args:
        logs: that were learned from.
        fit: what was found.
        verdict: how surely.
        ahead: predictions of other drives, or of the logs themselves; none where they are too short.
        own: whether they are of the logs themselves.
    """
    short = " No drive is long enough to be predicted." if verdict.identified else ""  # else nothing predicts any
    said = f" {beside(ahead, own)}" if ahead else short
    if why := _no_good(logs, fit, verdict, ahead, own):
        return Conclusion(False, f"These numbers are not good: {why}.{said}")
    known, lost = told(verdict.estimates)
    text = "These numbers are good for tuning" if not lost else f"These numbers are good for {_listed(known)}"
    text += f", not for {_listed(lost)}" if lost else ""
    if lacks := verdict.left.lacks:
        text += f"; their intervals may be too narrow, since the model lacks something in {_listed(lacks)}"
    if change := verdict.left.change:
        text += f"; from t = {change.t:.0f} s on the machine behaves differently ({change.name} by {change.by:+.2g})"
    return Conclusion(True, f"{text}.{said}")


def told(estimates: Sequence[Estimate]) -> tuple[list[str], list[str]]:
    """Kinds of numbers that the log tells, and those that it does not tell, or not all of."""
    known, lost = [], []
    for kind, of_it in _by_kind(estimates).items():
        some = sum(e.identified or e.absent for e in of_it)
        part = f"{some} of {len(of_it)} numbers of {kind}"
        if some:
            known.append(kind if some == len(of_it) else part)
        if some < len(of_it):
            lost.append(kind if not some else "the others")
    return known, list(dict.fromkeys(lost))


def beside(ahead: Sequence[Prediction], own: bool) -> str:
    """How well drives are predicted, beside plain models."""
    which = "The same drive" if own else "A drive that it has not seen" if len(ahead) == 1 else "Unseen drives"
    parts = [f"{1e3 * rms:.0f} mm with {name}" for name, rms in plain(ahead).items()]
    text = f"{which} {'is' if own or len(ahead) == 1 else 'are'} predicted {ahead[0].horizon:g} s ahead"
    text += f" with an rms of {1e3 * together([(p.rms, p.windows) for p in ahead]):.0f} mm"
    return text + (f" ({', '.join(parts)})." if parts else ".") + (" Give another with --unseen." if own else "")


def plain(ahead: Sequence[Prediction]) -> dict[str, float]:
    """The rms [m] of plain models over all predictions, by name."""
    names = [name for name in (ahead[0].plain if ahead else {}) if all(name in p.plain for p in ahead)]
    return {name: together([(p.plain[name], p.windows) for p in ahead]) for name in names}


def together(parts: Sequence[tuple[float, int]]) -> float:
    """The rms of several, each of so many windows."""
    rms, windows = np.array(parts, float).T
    return float(np.sqrt((rms**2) @ windows / windows.sum()))


def _no_good(logs: Sequence[Log], fit: Fit, verdict: FitVerdict, ahead: Sequence[Prediction], own: bool) -> str:
    """Why numbers are good for nothing; empty where they are."""
    if not verdict.identified:
        alike = next((f": {e.name} {e.reason}" for e in verdict.estimates if e.alike), "")
        advice = "; leave one of them out of --fit, as it is assumed, or drive what tells them apart" if alike else ""
        return f"this drive tells none of what was asked for{alike}{advice}"
    counted = int((fit.segments.weight > 0).sum())
    if (lost := fit.counts.outliers / max(counted + fit.counts.outliers, 1)) > LOST:
        return f"{lost:.0%} of the measurements fit nothing and were left out"
    if not ahead:
        return ""
    rms, others = together([(p.rms, p.windows) for p in ahead]), plain(ahead)
    places = [fit.model.channels.index(name) for name in ("x", "y")]
    seen = float(np.hypot(*noise(logs)[places]))
    lacks = verdict.left.lacks
    if others and rms > (LACKING if lacks else BETTER) * min(others.values()) and rms > CLOSE * seen:
        best = min(others, key=lambda name: others[name])
        how = "no better" if rms >= others[best] else f"only {1 - rms / others[best]:.0%} better"
        why = f"they explain {'the' if own else 'another'} drive {how} than {best}"
        return f"{why}, and the model lacks something in {_listed(lacks)}" if lacks else why
    return ""


def _by_kind(estimates: Sequence[Estimate]) -> Mapping[str, list[Estimate]]:
    """Estimates by the first of `KINDS` that they are of."""
    found: dict[str, list[Estimate]] = {}
    for e in estimates:
        kind = next(k for k, (begin, end) in KINDS.items() if e.name.startswith(begin) and e.name.endswith(end))
        found.setdefault(kind, []).append(e)
    return found


def _listed(words: Sequence[str]) -> str:
    """Words as a person lists them."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
