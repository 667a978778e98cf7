"""With plain rclpy: receive every reference at 1 kHz, and plot speed and stiffness.

In another terminal: gdmp examples lasa GShape -o demos && gdmp learn demos/GShape_* -o skill.json
&& gdmp up skill.json
"""
import sys
import time

from gdmp_msgs.msg import Reference
from matplotlib import pyplot as plt
import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_srvs.srv import Trigger

rclpy.init()
node, references = Node('example'), []
# A short history loses messages while this process is late; Fast DDS keeps 5000 at most.
qos = QoSProfile(depth=5000, reliability=ReliabilityPolicy.RELIABLE)
node.create_subscription(Reference, 'trajectory_server/reference', references.append, qos)
start = node.create_client(Trigger, 'trajectory_server/start')
if not start.wait_for_service(timeout_sec=10.0):
    sys.exit('no trajectory server answers: start "gdmp up skill.json" in another terminal')
began = start.call_async(Trigger.Request())
executor = SingleThreadedExecutor()
executor.add_node(node)
executor.spin_until_future_complete(began)
if not began.result().success:
    sys.exit(began.result().message)


def seconds(reference):
    """When a reference was made."""
    return reference.header.stamp.sec + 1e-9 * reference.header.stamp.nanosec


# Eight seconds of the stream, by its stamps: a busy machine receives fewer references.
end = time.monotonic() + 60.0
while not references or seconds(references[-1]) < seconds(references[0]) + 8.0:
    executor.spin_once(timeout_sec=0.1)
    if time.monotonic() > end:
        sys.exit('the stream ended before eight seconds were received')

times = np.array([seconds(reference) for reference in references])
lines = np.array([(r.twist.linear.x, r.twist.linear.y, r.twist.linear.z) for r in references])
stiffness = np.array([r.stiffness for r in references]).reshape(-1, 6, 6)[:, :3, :3]
lost = int(references[-1].sequence - references[0].sequence) + 1 - len(references)
print(f'{len(references)} references, {lost} lost')

figure, (upper, lower) = plt.subplots(2, sharex=True, figsize=(7, 5), layout='constrained')
upper.plot(times - times[0], np.linalg.norm(lines, axis=1))
upper.set(ylabel='speed [m/s]')
for name, values in zip(('smallest', 'middle', 'largest'), np.linalg.eigvalsh(stiffness).T):
    lower.plot(times - times[0], values, label=f'stiffness, {name}')
lower.set(xlabel='time [s]', ylabel='stiffness [N/m]')
figure.legend(loc='outside upper center', ncols=3)
figure.savefig('17_plot_references.png')
rclpy.shutdown()
