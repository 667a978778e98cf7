"""A clock that is stepped: what waits for it runs in one thread, in the order of the times."""
import ctypes
import heapq
import itertools

from greenlet import getcurrent, greenlet

#: Wall time at which the clock begins, and its steady time [ns].
EPOCH, BEGIN = 1_700_000_000_000_000_000, 1_000_000_000
#: A loop that is to be resumed as soon as possible is, after this time [ns].
SOON = 1_000_000


class SteppedClock:
    """
    See `gdmp_ros.realtime.loop.Clock`; time passes in `run_until` and in sleeps only.

    Every call that the clock makes may sleep: it is set aside meanwhile (each runs in a greenlet),
    and everything else goes on.
    """

    def __init__(self):
        self._now, self._queue, self._numbers = BEGIN, [], itertools.count()
        self._idle, self._running = [], None

    def now(self):
        return self._now

    def wall(self):
        return EPOCH + self._now

    def sleep_until(self, deadline_ns):
        me = getcurrent()
        if not isinstance(me, Worker):
            self.run_until(deadline_ns)
        elif deadline_ns > self._now:
            self._add(deadline_ns, None, me)
            self._running.switch(None)

    def start(self, loop, priority=None):
        return SteppedLoop(self, loop)

    def at(self, when, call):
        """Call something at a time; calls of one time keep their order."""
        self._add(when, call, None)

    def soon(self, call):
        """Call something at the present time, after what is there already."""
        self.at(self._now, call)

    def every(self, period, call):
        """Call something periodically until it returns True."""
        def again():
            if call() is not True:
                self.at(self._now + period, again)
        self.at(self._now + period, again)

    def run_until(self, deadline, stop=lambda: False):
        """Let time pass until a deadline, or until ``stop()`` after one of the calls."""
        before, self._running = self._running, getcurrent()
        try:
            while self._queue and self._queue[0][0] <= deadline:
                when, _, call, worker = heapq.heappop(self._queue)
                self._now = max(self._now, when)
                if worker is None:
                    worker = self._idle.pop() if self._idle else Worker(self._work)
                error = worker.switch(call)
                if error is not None:
                    raise error
                if stop():
                    return
            self._now = max(self._now, deadline)
        finally:
            self._running = before

    def drop(self, worker):
        """Let a worker that sleeps never wake up."""
        self._queue = [one for one in self._queue if one[3] is not worker]
        heapq.heapify(self._queue)

    def _add(self, when, call, worker):
        heapq.heappush(self._queue, (max(when, self._now), next(self._numbers), call, worker))

    def _work(self, call):
        while True:
            error = None
            try:
                call()
            except Exception as raised:
                error = raised
            self._idle.append(getcurrent())
            call = self._running.switch(error)


class Worker(greenlet):
    """Makes one call of the clock after the other."""


class SteppedLoop:
    """See `gdmp_ros.realtime.loop.RunningLoop`."""

    scheduler = 'other'

    def __init__(self, clock, loop):
        self.failure, self._clock, self._loop = None, clock, loop
        self._paused_until, self._ending, self._worker = 0, False, None
        clock.soon(self._resume)

    def _resume(self):
        if self._loop is None:
            return
        if self._clock.now() < self._paused_until:
            self._clock.at(self._paused_until, self._resume)
            return
        self._worker = getcurrent()
        try:
            deadline = next(self._loop)
        except StopIteration:
            self._loop = None
        except Exception as error:
            self._loop, self.failure = None, error
        else:
            if self._ending:
                self._close()
            now = self._clock.now()
            self._clock.at(deadline if deadline > now else now + SOON, self._resume)
        self._worker = None

    def end(self):
        self._ending = True
        if self._worker is None:
            self._close()
        while self._loop is not None:  # it sleeps, and ends where it yields
            self._clock.sleep_until(self._clock.now() + SOON)

    def _close(self):
        loop, self._loop = self._loop, None
        if loop is not None:
            loop.close()

    def kill(self):
        """Let it run no more; what it would do at its end does not happen."""
        for one in (self._loop, self._worker):
            if one is not None:  # nor when Python collects what nobody needs
                ctypes.pythonapi.Py_IncRef(ctypes.py_object(one))
        if self._worker is not None:
            self._clock.drop(self._worker)
        self._loop = self._worker = None

    def pause(self, seconds):
        """Let it rest, as a process that is stopped does."""
        self._paused_until = self._clock.now() + round(1e9 * seconds)


class NodeClock:
    """
    A stepped clock as one node has it.

    :ivar loops: that the node has started
    """

    def __init__(self, clock):
        self.loops, self._clock = [], clock
        self.now, self.wall, self.sleep_until = clock.now, clock.wall, clock.sleep_until

    def start(self, loop, priority=None):
        made = self._clock.start(loop, priority)
        self.loops.append(made)
        return made

    def kill(self):
        """Let no loop run any more."""
        for one in self.loops:
            one.kill()
