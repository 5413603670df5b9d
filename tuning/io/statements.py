"""The kinds of claim that a report may make, each in its own words, which mean the same in every report."""

from __future__ import annotations

CONFIDENCE = 0.95
PERCENT = f"{100 * CONFIDENCE:g} %"
FOUND = "worst found"
PROVED = "proved"
PROBABLE = "with probability"
INTERVAL = f"{PERCENT} interval"
NAMED = "worst before a metric, in goals and limits: the largest of the runs that the sentence or the section is about"
MEANING = {
    FOUND: "the largest value that a search met, which bounds the true largest below; no search bounds it above",
    PROVED: "follows from the equations, for all that they assume, without samples",
    PROBABLE: (
        f"of a vehicle drawn at random as the ensemble says; {PERCENT} is the confidence of the bound, which"
        " holds for the number of runs made"
    ),
    INTERVAL: f"of many such intervals {PERCENT} hold the true value, if the model is right",
}


def worst_of(count: int) -> str:
    """`worst of 256`: of so many random draws."""
    return f"worst of {count}"


def exceeding(count: int) -> float:
    """The largest share of all draws that may exceed the largest of `count` of them, with 95 % confidence.

    A share s lies above the largest of n independent draws with a chance of (1 - s)^n, which is 5 % at 1 - .05^(1/n)
    (Wilks, Annals of Mathematical Statistics 12, 1941).
    """
    return 1 - (1 - CONFIDENCE) ** (1 / count)


def of_draws(count: int, name: str = "") -> str:
    """What `worst of` so many random draws says; `name` is what a report calls it, if that is another."""
    return (
        f"{name or worst_of(count)}: the largest of {count} random draws; with {PERCENT} confidence at most"
        f" {exceeding(count):.2g} of all draws exceed it"
    )


def of_least(count: int, name: str) -> str:
    """The same of the smallest, under the name that a report gives it."""
    return of_draws(count, name).replace("largest", "smallest").replace("exceed it", "lie below it")


def of_kind(kind: str) -> str:
    """What `FOUND`, `PROVED`, `PROBABLE` or `INTERVAL` means, with its name before it."""
    return f"{kind}: {MEANING[kind]}"


def said(*sentences: str) -> str:
    """The line of a report that says what its words mean."""
    return "What the words mean: " + "; ".join(sentences) + "."
