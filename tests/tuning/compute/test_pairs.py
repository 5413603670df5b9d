"""Long jobs two at a time: their order, and what Ctrl-C does."""

import threading

import pytest

from tuning.compute.pairs import WORKERS, in_pairs


def test_results_come_in_order_and_no_more_than_two_are_under_way():
    running, most, lock = [], [], threading.Lock()

    def job(k):
        with lock:
            running.append(k)
            most.append(len(running))
        threading.Event().wait(0.02 * (4 - k))
        with lock:
            running.remove(k)
        return k * k

    assert in_pairs(job, range(4)) == [0, 1, 4, 9]
    assert max(most) == WORKERS == 2


def test_ctrl_c_lets_what_is_under_way_end_begins_nothing_else_and_says_so(capsys):
    begun, ended = [], []

    def job(k):
        begun.append(k)
        if k == 0:
            raise KeyboardInterrupt  # as the main thread gets it, while it waits for the first
        threading.Event().wait(0.2)
        ended.append(k)

    with pytest.raises(KeyboardInterrupt):
        in_pairs(job, range(8))
    assert sorted(ended) == [k for k in sorted(begun) if k] and len(begun) <= 3  # two end at the same time
    assert "what is under way ends first" in capsys.readouterr().err
