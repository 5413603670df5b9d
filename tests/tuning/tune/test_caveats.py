"""What is said of tuned gains besides the limits: from metrics written by hand."""

import dataclasses

import numpy as np
import pytest

import agvjax
from agvjax.metric_table import METRICS, Followed
from tuning.ensemble.worst import Found
from tuning.tune import caveats
from tuning.tune.gains import Gains
from tuning.tune.judge import TuneVerdict, summary
from tuning.tune.methods.objective import Objective, Requirement, within

GOAL = (Requirement("total_rmse", "mean", 1.0),)


def metrics(rmse, *, late=0.01, settled=True, ok=True, command=1.0):
    """Of B runs, B the length of `rmse`, which is that of x; all else is the same in every channel."""
    count = len(rmse)
    three = lambda value: np.broadcast_to(np.asarray(value, float).reshape(-1, 1), (count, 3))  # noqa: E731
    same = dict.fromkeys(("iae", "ise", "itae", "overshoot"), three(1.0))
    commands = ("rms_command", "peak_command", "chatter", "rms_delivered", "peak_delivered", "variation_delivered")
    commands += ("reversals_delivered",)
    return agvjax.Metrics(
        rmse=np.stack([rmse, np.zeros(count), np.zeros(count)], axis=1),
        rmse_late=three(late),
        settling_time=three(2.0),
        settled=np.broadcast_to(np.reshape(settled, (-1, 1)), (count, 3)),
        **dict.fromkeys(commands, three(command)),
        ok=np.broadcast_to(ok, count),
        limited=np.zeros(count),
        **same,
    )


def said(before, after, objective=None, budget=None):
    return caveats.unseen(objective or Objective(goals=GOAL, limits=()), before, after, budget, 0.05)[:2]


def test_gains_that_are_better_and_settle_need_no_word():
    assert said(metrics([0.2, 0.4]), metrics([0.1, 0.3])) == ([], [])


def test_a_run_that_diverges_is_a_failure_however_good_the_others_are():
    failures, _ = said(metrics([0.2] * 4), metrics([0.1] * 4, ok=[True, False, True, True]))
    assert failures[0] == "1 of 4 validation runs diverged (0 with the starting gains)"


def test_most_runs_unsettled_is_a_failure_and_few_are_a_caution():
    few, most = ([True, True, True, False], [False, False, False, True])
    failures, cautions = said(metrics([0.2] * 4), metrics([0.1] * 4, settled=few))
    assert failures == [] and cautions[0].startswith("1 of 4 validation runs have not settled within 0.05")
    failures, cautions = said(metrics([0.2] * 4), metrics([0.1] * 4, settled=most))
    assert failures[0].startswith("3 of 4 validation runs have not settled") and cautions == []


def test_where_all_diverged_before_none_had_settled_either():
    failures, _ = said(metrics([np.inf] * 4, ok=False), metrics([0.1] * 4, settled=False))
    assert failures[0].endswith("(all diverged before)")


def test_runs_too_short_to_settle_are_a_caution():
    runs = metrics([0.2] * 4, settled=False), metrics([0.1] * 4, settled=False)
    failures, cautions, _ = caveats.unseen(Objective(goals=GOAL, limits=()), *runs, None, 0.05, long=False)
    assert failures == [] and cautions[0].startswith("4 of 4 validation runs have not settled")


def test_gains_that_are_worse_where_nobody_tuned_are_a_failure():
    failures, _ = said(metrics([0.2, 0.4]), metrics([0.2, 0.5]))  # means 0.3 and 0.35
    assert failures == ["on the validation scenarios the goal is 16.7% worse than before"]


def test_a_goal_that_hides_behind_another_is_named_and_one_that_got_much_worse_is_a_failure():
    """Means 0.3 and 0.2, worst 0.4 and 0.45, then 0.7: the sum of ratios with weights 1 and 0.1 falls in both."""
    both = Objective(goals=(*GOAL, Requirement("total_rmse", "worst", 0.1)), limits=())
    before = metrics([0.2, 0.4, 0.3, 0.3])
    failures, cautions = said(before, metrics([0.1, 0.45, 0.1, 0.15]), both)
    assert failures == [] and "on the validation scenarios worst total_rmse is 1.12 times what it was" in cautions
    failures, _ = said(before, metrics([0.01, 0.7, 0.04, 0.05]), both)
    assert failures == ["on the validation scenarios worst total_rmse is 1.75 times what it was"]


def test_what_rises_though_the_goal_falls_is_named():
    _, cautions = said(metrics([0.2, 0.4], late=[0.01, 0.02]), metrics([0.1, 0.2], late=[0.015, 0.02]))
    assert "mean rmse_late_x rose from 0.015 to 0.0175 m (+17%)" in cautions
    assert not any("worst rmse_late_x" in line for line in cautions)


def test_limits_hold_relative_to_the_starting_gains_in_the_same_scenarios():
    objective = Objective(goals=GOAL, limits=within({"peak_heading": 1.0}))
    same = said(metrics([0.2] * 2, command=3.0), metrics([0.1] * 2, command=3.0), objective)
    assert same == ([], [])
    _, cautions = said(metrics([0.2] * 2, command=3.0), metrics([0.1] * 2, command=[3.0, 3.3]), objective)
    assert "on the validation scenarios mean peak_heading is 3.15 rad/s, 5.00% above its limit 3" in cautions
    assert "on the validation scenarios worst peak_heading is 3.3 rad/s, 10.00% above its limit 3" in cautions


@pytest.mark.parametrize("sent, named", [(3.029, False), (3.031, True)])
def test_a_limit_missed_by_less_than_a_hundredth_is_a_caveat_and_no_but(sent, named):
    objective = Objective(goals=GOAL, limits=within({"peak_heading": 1.0})[1:])
    runs = metrics([0.2] * 2, command=3.0), metrics([0.1] * 2, command=[2.0, sent])
    _, cautions, doubts = caveats.unseen(objective, *runs, None, 0.05)
    assert len(cautions) == 1 and "above its limit 3" in cautions[0] and bool(doubts) == named


def test_a_limit_missed_and_an_error_that_rose_where_nobody_tuned_are_named_in_the_verdict():
    """The second vehicle sends 3.3 rad/s of 3; its distance after the start rose from 100 to 106 mm, the mean fell."""

    def followed(peaks):
        some = dict.fromkeys((f.name for f in dataclasses.fields(Followed)), np.ones(2))
        return Followed(**some | {"cross_track_peak_late": np.array(peaks)})

    objective = Objective(goals=GOAL, limits=within({"peak_heading": 1.0})[1:])
    before, after = (
        dataclasses.replace(metrics([error] * 2, command=command), followed=followed(peaks))
        for error, command, peaks in ((0.2, 3.0, [0.1, 0.05]), (0.1, [2.7, 3.3], [0.01, 0.106]))
    )
    failures, cautions, doubts = caveats.unseen(objective, before, after, None, 0.05)
    assert failures == [] and len(cautions) == 2
    assert doubts == [
        "worst peak_heading is 10% above its limit on the validation scenarios",
        "worst cross_track_peak_late rose by 6%",
    ]
    verdict = TuneVerdict({}, {}, None, [], [], [], cautions, doubts, before, {}, None)
    assert verdict.failure == ""
    first, *rest = verdict.lines
    assert first.startswith(f"Tuned, but {doubts[0]}, {doubts[1]}; ") and rest == cautions


@pytest.mark.parametrize(
    ("value", "text"),
    [(9.0, ""), (10.005, ""), (12.0, "effort 12 mixed units, 20% above the limit 10"), (np.inf, "diverges")],
)
def test_the_worst_case_is_held_against_the_limit(value, text):
    objective = Objective(goals=GOAL, limits=within({"effort": 2.0}))
    baseline = np.full((3, 2), 5.0)  # mean, worst, tail of total_rmse and effort
    lines = caveats.worst_case(objective, [Found("effort", value, {}, 1, 1, 1)], baseline, {"effort": 20.0})
    assert (text in lines[0]) if text else lines == []


@pytest.mark.parametrize(("value", "said"), [(4.1, False), (4.3, True)])  # 4 and 5 %
def test_a_worst_case_that_the_starting_gains_stand_better_is_said_where_no_limit_is_on_it(value, said):
    objective, baseline = Objective(goals=GOAL, limits=()), np.full((3, 1), 5.0)
    lines = caveats.worst_case(objective, [Found("total_rmse", value, {}, 1, 1, 1)], baseline, {"total_rmse": 4.0})
    assert len(lines) == said
    text = "has total_rmse 4.3 m, rad, where the starting gains have 4 (--set tune.search.rounds=3"
    assert all(text in line for line in lines)


def test_gains_at_a_bound_other_than_0_are_named():
    gains = Gains(("k1", "zeta", "Lam"), np.array([1.0, 0.1, 0.0]), np.array([np.inf, 3.0, 50.0]))
    (line,) = caveats.at_bounds(gains, agvjax.NeuroBackstepping(k1=8.0, zeta=0.1003, Lam=0.001))
    assert line.startswith("zeta ended at its bound 0.1 ")


def test_commands_that_nothing_limits_and_that_rise_by_half_are_named():
    """A goal of error alone may be bought with commands that buzz."""
    assert said(metrics([0.2, 0.4]), metrics([0.1, 0.3], command=1.4)) == ([], [])
    _, cautions = said(metrics([0.2, 0.4]), metrics([0.1, 0.3], command=1.7))
    told = " ".join(cautions)
    for name in ("effort", "peak_position", "peak_heading", "total_chatter", "delivered_peak", "delivered_variation"):
        assert f"mean {name} rose" in told and "(+70%)" in told


@pytest.mark.parametrize("goal, worst", [("total_rmse", 1), ("rmse_late_x", 2)])
def test_the_run_that_is_shown_as_the_worst_is_that_of_the_first_goal_or_one_that_diverged(goal, worst):
    """A law that follows a route has no total_rmse: 0 in every run, and the first would be called the worst."""
    objective = Objective(goals=(Requirement(goal, "mean", 1.0),), limits=())
    runs = {"rmse": [0.1, 0.3, 0.2], "late": [0.01, 0.02, 0.05]}
    assert summary(metrics(**runs), objective).worst_index == worst
    assert summary(metrics(**runs, ok=[False, True, True]), objective).worst_index == 0


def of_a_route(*finished):
    """Metrics of runs that reach the end of a route at these times [s]."""
    size = len(finished)
    each = {name: np.zeros(size) for name, row in METRICS.items() if row.route} | {"time_to_finish": np.array(finished)}
    return dataclasses.replace(metrics([0.1] * size), followed=Followed(**each))


@pytest.mark.parametrize(
    ("before", "after", "horizon", "kinds"),
    [
        ([9.0] * 4, [9.0] * 4, 20.0, (0, 0, 0)),
        ([9.0] * 4, [9.0, 9.0, 9.0, np.inf], 20.0, (1, 0, 0)),  # one more than before
        ([9.0, 9.0, 9.0, np.inf], [9.0, np.inf, 9.0, 9.0], 20.0, (0, 1, 1)),
        ([np.inf] * 4, [np.inf] * 3 + [9.0], 20.0, (1, 0, 0)),  # most
        ([np.inf] * 4, [np.inf] * 4, 5.0, (0, 1, 1)),  # the run is too short to tell
    ],
)
def test_vehicles_that_do_not_reach_the_end_of_a_route_are_no_success(before, after, horizon, kinds):
    route = agvjax.Route.through(np.array([[0.0, 0.0], [2.0, 0.0], [4.0, 0.1]]), 0.5)  # 8 s
    said = caveats.unfinished(of_a_route(*before), of_a_route(*after), route, horizon)
    assert tuple(map(len, said)) == kinds
    ring = agvjax.Route.along(agvjax.Circle())
    assert not any(caveats.unfinished(of_a_route(*before), of_a_route(*after), ring, horizon))


def test_what_is_many_times_its_limit_is_said_so_and_not_in_thousands_of_percent():
    objective = Objective(goals=GOAL, limits=within({"peak_heading": 1.0})[1:])
    runs = metrics([0.2] * 2, command=3.0, late=0.01), metrics([0.1] * 2, command=[2.0, 171.0], late=0.04)
    _, cautions, doubts = caveats.unseen(objective, *runs, None, 0.05)
    assert "on the validation scenarios worst peak_heading is 171 rad/s, 57 times its limit 3" in cautions
    assert "mean rmse_late_x rose from 0.01 to 0.04 m (4 times)" in cautions
    assert doubts[0] == "worst peak_heading is 57 times its limit on the validation scenarios"
    assert "mean rmse_late_x rose to 4 times" in doubts


def test_of_vehicles_that_do_not_finish_those_that_stand_in_the_deadzone_are_told_from_those_on_their_way():
    route = agvjax.Route.through(np.array([[0.0, 0.0], [2.0, 0.0], [4.0, 0.1]]), 0.5)
    before, after = of_a_route(*[9.0] * 5), of_a_route(9.0, *[np.inf] * 4)
    standing = np.array([0.5, 0.04, 0.06, 0.9, 0.0])  # of 20 s; the first one finishes all the same
    after = dataclasses.replace(after, followed=dataclasses.replace(after.followed, standstill=standing))
    ((counted,), _, _) = caveats.unfinished(before, after, route, 20.0)
    assert counted.startswith(
        "4 of 5 validation runs do not reach the end of the route (0 before); 2 of them stand for 1"
    )
    assert counted.endswith("; 2 are on their way when the run ends after 20 s (simulate.horizon)")


@pytest.mark.parametrize(("restless", "named"), [(2, False), (3, True), (10, True), (11, False)])
def test_the_verdict_names_runs_that_have_not_settled_where_more_than_a_tenth_have_not(restless, named):
    """Of 20; more than half of them are a failure, which says so itself."""
    after = metrics([0.1] * 20, settled=[i >= restless for i in range(20)])
    found = caveats.unseen(Objective(goals=GOAL, limits=()), metrics([0.2] * 20), after, None, 0.05)
    assert (f"{restless} of 20 validation runs have not settled" in found.doubts) == named
    assert bool(found.failures) == (restless > 10)
