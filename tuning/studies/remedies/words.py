"""What the numbers of a comparison of remedies say: rows, and a paragraph that is computed from them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

import agvjax

from ...config.settings import Config
from ...io.files import Json
from .remedies import LABELS
from .study import Judged

SURE = 2.0  # standard errors of a mean difference beyond which it is told from none


class Difference(NamedTuple):
    """By how much the error of one remedy is below another's, vehicle by vehicle."""

    mean: float  # of the other's less its own, over the vehicles of which neither run diverged
    error: float  # standard error of that mean
    better: float  # share of the vehicles that it is better on

    @property
    def sure(self) -> bool:
        """Whether it can be told from none."""
        return abs(self.mean) > SURE * self.error


def metric_of(config: Config) -> str:
    """The error that is compared: the first goal's."""
    return next(iter(config.tune.goals))


def rows(judged: Mapping[str, Judged], metric: str) -> list[Json]:
    """One row a remedy, best first by its mean error after tuning without noise; over the runs that did not diverge."""
    made = []
    for name, one in judged.items():
        row: Json = {"remedy": name, "gains": len(one.gains), "met": one.found.excess == 0}
        row |= {
            "excess": float(one.found.excess),
            "use": one.use,
            "over": "; ".join(one.over),
            "jacobians": one.found.jacobians,
        }
        row |= {"unseen": int(np.size(one.after[0].ok)), "searches": one.found.searches, "rollouts": one.found.rollouts}
        for when, pair in (("before", one.before), ("after", one.after)):
            for noise, metrics in zip(("", "_noise"), pair, strict=True):
                row |= {f"{key}_{when}{noise}": value for key, value in _numbers(metrics, metric).items()}
        made.append(row)
    return sorted(made, key=lambda row: row["mean_after"])


def _numbers(metrics: agvjax.Metrics, metric: str) -> Json:
    ok = np.asarray(metrics.ok)
    found: Json = {"diverged": int(np.sum(~ok))}
    for key, name, how in (
        ("mean", metric, np.mean),
        ("worst", metric, np.max),
        ("variation", "delivered_variation", np.mean),
        ("reversals", "reversals", np.mean),
    ):
        found[key] = float(how(np.asarray(metrics[name])[ok])) if ok.any() else np.inf
    return found


def difference(one: agvjax.Metrics, other: agvjax.Metrics, metric: str) -> Difference:
    """How far `one` is below `other`, on the same vehicles."""
    ok = np.asarray(one.ok) & np.asarray(other.ok)
    less = np.asarray(other[metric])[ok] - np.asarray(one[metric])[ok]
    if less.size < 2:
        return Difference(float("nan"), np.inf, float("nan"))
    return Difference(float(less.mean()), float(less.std(ddof=1) / np.sqrt(less.size)), float(np.mean(less > 0)))


def statements(
    made: list[Json], judged: Mapping[str, Judged], wrong: Mapping[str, agvjax.Metrics], metric: str
) -> list[str]:
    """The conclusion; nothing is said that is not computed."""
    by = {row["remedy"]: row for row in made}
    sound = [row for row in made if row["met"] and not row["diverged_after"]]
    if not sound:
        return ["Every remedy exceeds the budget or has diverged runs: no conclusion."]
    said = [_best(sound, judged, by, metric)]
    said += _alike(sound, judged, metric)
    if "identified" in judged:
        said += _beliefs(by, wrong, metric)
    said += [_noise(sound, by), *_unfinished(judged, by, metric)]
    if lost := [LABELS[row["remedy"]] for row in made if not row["met"]]:
        said.append(f"The budget is exceeded on the tuning vehicles by: {'; '.join(lost)}.")
    if over := [LABELS[row["remedy"]] for row in made if row["over"] and row["met"]]:
        said.append(
            f"Met there but exceeded on the validation vehicles: {'; '.join(over)}; the report says by how much."
        )
    counts = [f"{LABELS[r['remedy']]} {r['diverged_after']}, {r['diverged_after_noise']} with noise" for r in made]
    counts = [c for c, r in zip(counts, made, strict=True) if r["diverged_after"] or r["diverged_after_noise"]]
    return [*said, f"Diverged runs after tuning: {'; '.join(counts) or 'none'}."]


def _best(sound: list[Json], judged: Mapping[str, Judged], by: Mapping[str, Json], metric: str) -> str:
    first, nothing = sound[0], by["nothing"]
    if first is nothing:
        return "Within the budget no remedy has a smaller mean error than the law without one, tuned too."
    gap = difference(judged[first["remedy"]].after[0], judged["nothing"].after[0], metric)
    ratio = first["mean_after"] / nothing["mean_after"]
    text = (
        f"Smallest mean error within the budget: {LABELS[first['remedy']]}, {ratio:.2f} times that"
        f" without a remedy (also tuned); the error is smaller on {gap.better:.0%} of the vehicles, the largest error"
        f" is {first['worst_after'] / nothing['worst_after']:.2f} times that without a remedy."
    )
    text += (
        f" On these vehicles it uses up to {first['use']:.2f} times a limit, no remedy {nothing['use']:.2f}: an"
        " advantage smaller than the extra use may come from that alone."
    )
    return text if gap.sure else f"{text} The mean difference is within {SURE:g} standard errors and may be chance."


def _alike(sound: list[Json], judged: Mapping[str, Judged], metric: str) -> list[str]:
    """Which of the others cannot be told from the best, and which not from nothing."""
    said, best = [], sound[0]["remedy"]
    for target, words in ((best, "the best"), ("nothing", "no remedy")):
        alike = [
            LABELS[row["remedy"]]
            for row in sound
            if row["remedy"] not in (best, "nothing", target)
            and not difference(judged[row["remedy"]].after[0], judged[target].after[0], metric).sure
        ]
        if alike and (target != best or best != "nothing"):
            said.append(f"Within {SURE:g} standard errors of {words}: {'; '.join(alike)}.")
    nothing = judged["nothing"].after[0]
    worse = [
        f"{LABELS[row['remedy']]} {row['mean_after'] / float(np.mean(np.asarray(nothing[metric])[nothing.ok])):.3f}"
        for row in sound
        if (gap := difference(judged[row["remedy"]].after[0], nothing, metric)).sure and gap.mean < 0
    ]
    return [*said, *([f"Worse than no remedy (ratio of mean errors): {'; '.join(worse)}."] if worse else [])]


def _beliefs(by: Mapping[str, Json], wrong: Mapping[str, agvjax.Metrics], metric: str) -> list[str]:
    """What a wrong assumption costs, when tuned with it, and when it replaces the right one after tuning."""
    right, said = by["identified"]["mean_after"], []
    names = [name for name in ("nominal", "fitted", "too_large", "too_small", "adaptive") if name in by]
    ratios = "; ".join(f"{LABELS[n]} {by[n]['mean_after'] / right:.2f}" for n in names)
    said.append(f"Mean error relative to the inverse of each vehicle's own deadzone, each tuned: {ratios}.")
    parts = []
    for name, metrics in wrong.items():
        ok = np.asarray(metrics.ok)
        mean = float(np.mean(np.asarray(metrics[metric])[ok])) if ok.any() else np.inf
        lost = f", {int(np.sum(~ok))} diverge" if not ok.all() else ""
        parts.append(f"{'1.5' if name == 'too_large' else '0.5'} times the true ones {mean / right:.2f}{lost}")
    if parts:
        said.append(f"Tuned with the true thresholds, then run with wrong ones: {'; '.join(parts)} times its error.")
    return said


def _unfinished(judged: Mapping[str, Judged], by: Mapping[str, Json], metric: str) -> list[str]:
    """Signs that the searches were too short, or the tuning vehicles too few."""
    said = [
        f"{LABELS[row['remedy']]} is worse than with its own gains, {row['mean_after'] / row['mean_before']:.2f} times"
        for row in by.values()
        if row["mean_after"] > row["mean_before"]
    ]
    if {"nominal", "fitted"} <= set(judged):
        gap = difference(judged["fitted"].after[0], judged["nominal"].after[0], metric)
        if gap.sure and gap.mean < 0:
            ratio = by["fitted"]["mean_after"] / by["nominal"]["mean_after"]
            said.append(f"{LABELS['fitted']} includes {LABELS['nominal']}, yet ended at {ratio:.2f} times its error")
    why = "small differences mean nothing without more tune.iterations or a larger ensemble.size."
    return [f"{'; '.join(said)}: {why}"] if said else []


def _noise(sound: list[Json], by: Mapping[str, Json]) -> str:
    """Who is best with noise, and whose commands then reverse most."""
    kept = [row for row in sound if not row["diverged_after_noise"]] or sound
    first = min(kept, key=lambda row: row["mean_after_noise"])
    most = max(kept, key=lambda row: row["reversals_after_noise"])
    ratio = first["mean_after_noise"] / by["nothing"]["mean_after_noise"]
    return (
        f"Smallest mean error with noise: {LABELS[first['remedy']]}, {ratio:.2f} times that without a remedy;"
        f" most reversals: {LABELS[most['remedy']]}, {most['reversals_after_noise']:.0f} per run, against"
        f" {by['nothing']['reversals_after_noise']:.0f} without a remedy."
    )
