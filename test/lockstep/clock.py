"""A clock that is stepped: what waits for it runs in one thread, in the order of the times."""
import heapq
import itertools

#: Wall time at which the clock begins, and its steady time [ns].
EPOCH, BEGIN = 1_700_000_000_000_000_000, 1_000_000_000
#: A loop that is to be resumed as soon as possible is, after this time [ns].
SOON = 1_000_000


class SteppedClock:
    """
    See `gdmp_ros.realtime.loop.Clock`; time passes in `run_until` and in sleeps only.

    A sleep inside of something that runs lets everything else go on.
    """

    def __init__(self):
        self._now, self._queue, self._numbers = BEGIN, [], itertools.count()

    def now(self):
        return self._now

    def wall(self):
        return EPOCH + self._now

    def sleep_until(self, deadline_ns):
        self.run_until(deadline_ns)

    def start(self, loop, priority=None):
        return SteppedLoop(self, loop)

    def at(self, when, call):
        """Call something at a time; calls of one time keep their order."""
        heapq.heappush(self._queue, (max(when, self._now), next(self._numbers), call))

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
        while self._queue and self._queue[0][0] <= deadline:
            when, _, call = heapq.heappop(self._queue)
            # A call may have slept, and others are late then.
            self._now = max(self._now, when)
            call()
            if stop():
                return
        self._now = max(self._now, deadline)


class SteppedLoop:
    """See `gdmp_ros.realtime.loop.RunningLoop`."""

    scheduler = 'other'

    def __init__(self, clock, loop):
        self.failure, self._clock, self._loop = None, clock, loop
        clock.soon(self._resume)

    def _resume(self):
        if self._loop is None:
            return
        try:
            deadline = next(self._loop)
        except StopIteration:
            self._loop = None
        except Exception as error:
            self._loop, self.failure = None, error
        else:
            now = self._clock.now()
            self._clock.at(deadline if deadline > now else now + SOON, self._resume)

    def end(self):
        loop, self._loop = self._loop, None
        if loop is not None:
            loop.close()

    def kill(self):
        """Let it run no more; what it would do at its end does not happen."""
        self._loop = None


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
