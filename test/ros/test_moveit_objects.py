"""
Objects of MoveIt, by the fields of their messages.

``moveit_msgs`` cannot be installed here: these have the fields of its public definitions.
"""
from dataclasses import dataclass, field
from types import SimpleNamespace

from geometry_msgs.msg import Point, Pose
import numpy as np
import pytest
from shape_msgs.msg import Mesh, MeshTriangle, Plane, SolidPrimitive
from std_msgs.msg import Header

from gdmp_ros.manifolds.poses import compose, IDENTITY
from gdmp_ros.ros.frames import FrameError
from gdmp_ros.ros.messages import pose_message
from gdmp_ros.ros.scene.moveit import ADD, APPEND, MOVE, PlanningObjects, REMOVE
from gdmp_ros.scene import Scene
from gdmp_ros.scene.distance import distances
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.tool_shape import tool_frames
from gdmp_ros.sim.urdf import link_names

BASE = 'panda_link0'
#: A frame that is 0.5 m before the base.
WORLD = np.array([0.5, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
BOX = SolidPrimitive(type=SolidPrimitive.BOX, dimensions=[0.1, 0.2, 0.3])


@dataclass
class CollisionObject:
    id: str
    operation: bytes = ADD
    header: Header = field(default_factory=lambda: Header(frame_id='world'))
    pose: Pose = field(default_factory=Pose)
    primitives: list = field(default_factory=list)
    primitive_poses: list = field(default_factory=list)
    meshes: list = field(default_factory=list)
    mesh_poses: list = field(default_factory=list)
    planes: list = field(default_factory=list)
    plane_poses: list = field(default_factory=list)


@dataclass
class AttachedCollisionObject:
    object: CollisionObject
    link_name: str = 'panda_hand'
    touch_links: list = field(default_factory=list)


def planning_scene(objects=(), attached=(), is_diff=True, allowed=()):
    names = list(dict.fromkeys(name for pair in allowed for name in pair))
    matrix = SimpleNamespace(entry_names=names, entry_values=[SimpleNamespace(enabled=[
        (one, other) in allowed or (other, one) in allowed for other in names]) for one in names])
    return SimpleNamespace(
        is_diff=is_diff, world=SimpleNamespace(collision_objects=list(objects)),
        robot_state=SimpleNamespace(attached_collision_objects=list(attached)),
        allowed_collision_matrix=matrix)


def at(x, y, z):
    return pose_message(np.array([x, y, z, 1.0, 0.0, 0.0, 0.0]))


def box(name, place, **others):
    return CollisionObject(name, pose=at(*place), primitives=[BOX], primitive_poses=[Pose()],
                           **others)


@pytest.fixture
def known():
    arm = Arm()

    class Known:
        def __init__(self):
            self.scene, self.refused, self.time = Scene(), [], 0.0
            self.tool = arm.pose_at(arm.home)
            self.frames = {'world': WORLD, BASE: None}

        def beside(self, source, volumes):
            self.scene = Scene(volumes)

        def place_of(self, header):
            if header.frame_id not in self.frames:
                raise FrameError(f'frame {header.frame_id!r} is not connected')
            return self.frames[header.frame_id]
    made = Known()
    made.objects = PlanningObjects(made, made.place_of, lambda: tool_frames(arm, BASE),
                                   lambda: made.tool, lambda: link_names(arm, BASE),
                                   made.refused.append, lambda: made.time)
    return made


def test_objects_are_added_moved_and_removed(known):
    known.objects.take_object(box('crate', (0.1, 0.2, 0.3)))
    volume = known.scene['crate']
    assert volume.kind == 'box' and volume.size == (0.1, 0.2, 0.3)
    np.testing.assert_allclose(volume.pose, [0.6, 0.2, 0.3, 1.0, 0.0, 0.0, 0.0])
    known.objects.take_object(CollisionObject('crate', MOVE, pose=at(0.0, 0.0, 0.5)))
    np.testing.assert_allclose(known.scene['crate'].pose[:3], [0.5, 0.0, 0.5])
    more = CollisionObject('crate', APPEND, pose=at(0.0, 0.0, 0.9), primitive_poses=[Pose()],
                           primitives=[SolidPrimitive(type=SolidPrimitive.CYLINDER,
                                                      dimensions=[0.4, 0.05])])
    known.objects.take_object(more)
    assert known.scene.names == ('crate#1', 'crate#2')
    assert known.scene['crate#2'].size == (0.05, 0.4)  # radius, length
    known.objects.take_object(CollisionObject('crate', MOVE, pose=at(0.0, 0.0, 0.6)))
    np.testing.assert_allclose(known.scene['crate#2'].pose[:3], [0.5, 0.0, 1.0])
    known.objects.take_object(box('other', (0.0, 0.0, 0.0)))
    known.objects.take_object(CollisionObject('crate', REMOVE))
    assert known.scene.names == ('other',)
    known.objects.take_object(CollisionObject('', REMOVE))
    assert len(known.scene) == 0 and known.refused == []


def test_meshes_planes_and_spheres_hold_their_points(known, rng):
    corners = rng.uniform(-0.1, 0.1, (4, 3))
    mesh = Mesh(vertices=[Point(x=x, y=y, z=z) for x, y, z in corners], triangles=[
        MeshTriangle(vertex_indices=np.array(three, dtype=np.uint32))
        for three in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))])
    known.objects.take_object(CollisionObject(
        'thing', header=Header(frame_id=BASE), pose=at(0.4, 0.0, 0.3), meshes=[mesh],
        mesh_poses=[Pose()]))
    assert distances(known.scene.packed(), corners + [0.4, 0.0, 0.3]).max() < 1e-9
    # Solid where a x + b y + c z + d is negative.
    coefficients, points = np.array([0.6, 0.0, -0.8, 0.5]), rng.uniform(-3.0, 3.0, (50, 3))
    for sign in (1.0, -1.0):
        plane = Plane(coef=(sign * np.array([0.0, 0.0, 1.0, 0.2])).tolist())
        known.objects.take_object(CollisionObject('thing', header=Header(frame_id=BASE),
                                                  planes=[plane], plane_poses=[Pose()]))
        np.testing.assert_allclose(distances(known.scene.packed(), points),
                                   sign * (points[:, 2] + 0.2), atol=1e-9)
    known.objects.take_object(CollisionObject(
        'thing', header=Header(frame_id=BASE), planes=[Plane(coef=coefficients.tolist())],
        plane_poses=[Pose()]))
    np.testing.assert_allclose(distances(known.scene.packed(), points),
                               points @ coefficients[:3] + coefficients[3], atol=1e-9)
    known.objects.take_object(CollisionObject(
        'ball', primitive_poses=[Pose()], primitives=[SolidPrimitive(
            type=SolidPrimitive.SPHERE, dimensions=[0.07])]))
    assert known.scene['ball'].size == (0.07,) and known.refused == []


def test_what_is_attached_moves_with_the_tool_and_stays_where_it_is_let_go(known):
    known.objects.take_object(box('cube', (0.0, 0.1, 0.2)))
    before = known.scene['cube'].pose
    known.objects.take_attached(AttachedCollisionObject(CollisionObject('cube')))
    assert known.scene['cube'].carried and known.scene.names == ()
    np.testing.assert_allclose(compose(known.tool, known.scene['cube'].pose), before, atol=1e-9)
    known.tool = known.tool + [0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    known.objects.take_scene(planning_scene(attached=[
        AttachedCollisionObject(CollisionObject('cube', REMOVE))]))
    assert not known.scene['cube'].carried
    np.testing.assert_allclose(known.scene['cube'].pose[:3], before[:3] + [0.1, 0.0, 0.0],
                               atol=1e-9)
    # With shapes of its own, in the frame of the hand.
    held = box('bar', (0.0, 0.0, 0.1034), header=Header(frame_id='panda_hand'))
    known.objects.take_attached(AttachedCollisionObject(held))
    np.testing.assert_allclose(known.scene['bar'].pose, IDENTITY, atol=1e-6)
    assert known.refused == []


def test_a_planning_scene_replaces_all_or_only_adds_and_says_what_may_touch(known):
    known.objects.take_object(box('old', (0.0, 0.0, 0.0)))
    known.objects.take_scene(planning_scene([box('new', (0.1, 0.0, 0.0))]))
    assert known.scene.names == ('old', 'new')
    known.objects.take_scene(planning_scene([box('new', (0.1, 0.0, 0.0))], is_diff=False,
                                            allowed=[('new', 'panda_hand'), ('new', 'table')]))
    assert known.scene.names == ('new',) and known.scene['new'].allowed == ('hand',)


@pytest.mark.parametrize(('message', 'reason'), [
    (CollisionObject('a', MOVE), 'not known'), (CollisionObject('a'), 'no shape'),
    (box('a', (0, 0, 0), header=Header(frame_id='moon')), "'moon' is not connected"),
    (CollisionObject('a', primitives=[SolidPrimitive(type=9)], primitive_poses=[Pose()]),
     'type 9'),
    (CollisionObject('a', planes=[Plane(coef=[0.0] * 4)], plane_poses=[Pose()]), 'a normal'),
    (CollisionObject('held', MOVE), 'it is attached'),
    (box('a#1', (0, 0, 0)), 'parts of an object'),
    (AttachedCollisionObject(CollisionObject('b')), 'not known'),
    (AttachedCollisionObject(box('b', (0, 0, 0)), 'panda_link3'), 'moves with the tool')])
def test_what_is_wrong_is_refused_and_changes_nothing(known, message, reason):
    known.objects.take_object(box('there', (0.0, 0.0, 0.0)))
    known.objects.take_attached(AttachedCollisionObject(box(
        'held', (0, 0, 0), header=Header(frame_id='panda_hand'))))
    take = (known.objects.take_attached if isinstance(message, AttachedCollisionObject)
            else known.objects.take_object)
    take(message)
    known.time += 1.0
    known.objects.look()
    assert reason in known.refused[-1] and known.scene.names == ('there',)


def test_a_message_waits_for_its_frame_and_what_is_attached_is_not_of_the_world(known):
    known.objects.take_object(box('far', (0, 0, 0), header=Header(frame_id='moon')))
    known.objects.take_object(box('near', (0.0, 0.0, 0.0)))
    assert known.scene.names == () and known.refused == []
    known.frames['moon'] = WORLD
    known.objects.look()
    assert known.scene.names == ('far', 'near')
    known.objects.take_attached(AttachedCollisionObject(CollisionObject('near')))
    known.objects.take_object(CollisionObject('near', REMOVE))
    known.objects.take_object(CollisionObject('', REMOVE))
    assert known.scene.names == () and known.scene['near'].carried
