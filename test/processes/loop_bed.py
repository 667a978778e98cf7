"""An arm whose compiled loop a test runs itself, over real DDS."""
import threading

import rclpy


class LoopBed:
    """
    A node that is active without threads of its own: the test makes its ticks.

    A subclass makes ``node``, its ``loop``, ``cycles`` and ``out``, ``states`` (a subscription to
    its states) and ``client``.

    :ivar every_s: time between two calls that let the loop look at Python
    """

    every_s = 0.005

    def close(self):
        self.node.active = False
        self.node.take_down()
        self.node.destroy_node()
        self.client.close()
        rclpy.shutdown()

    def run(self, until):
        """Let the loop run; it looks at Python again and again, as for requests."""
        ended = threading.Event()

        def call():
            while not ended.wait(self.every_s):
                self.loop.call()
        thread = threading.Thread(target=call)
        thread.start()
        try:
            while not until():
                next(self.cycles)
        finally:
            ended.set()
            thread.join()

    def received(self):
        """The states that have come, after the last one was sent."""
        found = []
        while not found or found[-1].tick < self.out.written[0]:
            message = self.states.take_message()
            if message is not None:
                found.append(message)
        return found
