"""Messages of fast topics: callbacks are too slow for them."""
from gdmp_ros.ros.middleware import DEEP, deserialized


class Collected:
    """All messages of a fast topic since the last `clear`; each is read when it is looked at."""

    def __init__(self, client, kind, topic):
        self.subscription = client.subscribe(kind, topic, depth=DEEP)
        self._data, self._read = [], {}

    def take(self):
        """Take what has come."""
        while (received := self.subscription.take()) is not None:
            self._data.append(received.data)

    def clear(self):
        self.take()
        self._data.clear()
        self._read.clear()

    def __len__(self):
        self.take()
        return len(self._data)

    def __getitem__(self, at):
        count = len(self)
        if isinstance(at, slice):
            return [self[k] for k in range(*at.indices(count))]
        k = range(count)[at]
        if k not in self._read:
            self._read[k] = deserialized(self._data[k], self.subscription.kind)
        return self._read[k]
