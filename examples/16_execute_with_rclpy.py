"""With plain rclpy: execute a skill on running nodes, and switch its goal on the way.

In another terminal: gdmp examples lasa GShape -o demos && gdmp learn demos/GShape_* -o skill.json
&& gdmp up skill.json
"""
import sys

from gdmp_msgs.action import ExecuteSkill
from gdmp_msgs.msg import ServerState
from geometry_msgs.msg import PoseStamped
from matplotlib import pyplot as plt
import numpy as np
import rclpy
from rclpy.action import ActionClient
from rclpy.node import Node

rclpy.init()
node = Node('example')
states, path = [], []
node.create_subscription(ServerState, 'trajectory_server/state', states.append, 10)
node.create_subscription(PoseStamped, 'panda_sim/measured_pose', path.append, 100)
goals = node.create_publisher(PoseStamped, 'trajectory_server/goal_pose', 1)
client = ActionClient(node, ExecuteSkill, 'trajectory_server/execute')
if not client.wait_for_server(timeout_sec=10.0):
    sys.exit('no trajectory server answers: start "gdmp up skill.json" in another terminal')

sent = client.send_goal_async(ExecuteSkill.Goal())
rclpy.spin_until_future_complete(node, sent)
if not sent.result().accepted:
    sys.exit('the server refused: it needs a skill, "gdmp up skill.json"')
ended, switched = sent.result().get_result_async(), False
while not ended.done():
    rclpy.spin_once(node, timeout_sec=0.1)
    # Half-way the goal moves by 8 cm to the left.
    if states and not switched and states[-1].progress > 0.5 and not states[-1].finished:
        new = PoseStamped(pose=states[-1].goal[0])
        new.header.frame_id = states[-1].header.frame_id
        new.pose.position.y += 0.08
        goals.publish(new)
        switched = True
result = ended.result().result
print(result.error_string or f'the goal was reached, within {result.robot_distance[0]:.4f} m')

measured = np.array([(p.pose.position.x, p.pose.position.y) for p in path])
goal = states[-1].goal[0].position
figure, axes = plt.subplots(figsize=(5, 5), layout='constrained')
axes.plot(*measured.T, label='arm')
axes.plot(goal.x, goal.y, 'o', label='goal after the switch')
axes.set(xlabel='x [m]', ylabel='y [m]', aspect='equal')
figure.legend(loc='outside upper center', ncols=2)
figure.savefig('16_execute_with_rclpy.png')
rclpy.shutdown()
