"""Threads that wait for work: what they return and raise, and that they end with their owner."""

from __future__ import annotations

import gc
import os
import signal
import threading
import time

import pytest

from flag_env.physics import Simulator, presets
from flag_env.physics.runtime.threads import Threads


@pytest.mark.parametrize("count", [1, 2, 5])
def test_each_call_gets_its_number_and_results_keep_their_order(count):
    threads = Threads(count)
    for _ in range(20):
        assert threads.run(lambda i: (time.sleep(0.001 * (count - i)), i)[1]) == list(range(count))


@pytest.mark.parametrize("raising", [0, 1, 2])
def test_what_a_call_raises_is_raised_after_all_have_ended(raising):
    threads, ended = Threads(3), []

    def call(i):
        if i == raising:
            raise KeyError(i)
        time.sleep(0.02)
        ended.append(i)

    with pytest.raises(KeyError, match=str(raising)):
        threads.run(call)
    assert sorted(ended) == [i for i in range(3) if i != raising]
    assert threads.run(lambda i: i) == [0, 1, 2]


def test_an_interrupt_is_raised_after_all_have_ended_and_mixes_up_nothing():
    threads, ended = Threads(2), []

    def call(i):
        if i == 1:
            time.sleep(0.3)
            ended.append(i)
        return i

    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore the signal
    timer = threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            threads.run(call)
        timer.join()
    finally:
        signal.signal(signal.SIGINT, before)
    assert ended == [1]
    assert threads.run(lambda i: 10 * i) == [0, 10]


def test_threads_end_with_their_simulator():
    before = set(threading.enumerate())
    sim = Simulator(presets.flag(4, 5), copies=400, threads=3)
    sim.step(20)
    own = set(threading.enumerate()) - before
    assert len(own) == 2
    del sim
    gc.collect()
    for thread in own:
        thread.join(10.0)
        assert not thread.is_alive()
