"""The description says the same as the model: MuJoCo reads it back."""
import mujoco
import numpy as np
import pytest

from gdmp_ros import DataError
from gdmp_ros.sim import urdf
from gdmp_ros.sim.arm import Arm


def read_back(arm, **options):
    spec = mujoco.MjSpec.from_string(urdf.urdf(arm, **options))
    spec.compiler.fusestatic = False
    model = spec.compile()
    return model, mujoco.MjData(model)


def test_frames_masses_and_limits_are_those_of_the_model(rng):
    arm = Arm()
    model, data = read_back(arm)
    assert [model.joint(i).name for i in range(model.njnt)] == [
        f'panda_{name}' for name in arm.names] == urdf.joint_names(arm, 'panda_link0')
    for _ in range(5):
        posture = rng.uniform(arm.limits.lower, arm.limits.upper)
        arm.reset(posture)
        data.qpos[:] = posture
        mujoco.mj_forward(model, data)
        for ours in ('link1', 'link4', 'link7', 'hand', 'left_finger'):
            np.testing.assert_allclose(data.body(f'panda_{ours}').xpos, arm.data.body(ours).xpos,
                                       atol=1e-12)
            np.testing.assert_allclose(data.body(f'panda_{ours}').xmat, arm.data.body(ours).xmat,
                                       atol=1e-12)
        np.testing.assert_allclose(data.body('panda_tcp').xpos, arm.data.site('tcp').xpos,
                                   atol=1e-12)
        inertia = np.zeros((7, 7))
        mujoco.mj_fullM(model, data, inertia)
        # URDF knows no armature.
        np.testing.assert_allclose(inertia + np.diag(arm.model.dof_armature),
                                   arm.measure().inertia, atol=1e-12)
    np.testing.assert_allclose(model.jnt_range, np.column_stack([arm.limits.lower,
                                                                 arm.limits.upper]))


def test_shapes_lie_where_the_geoms_are():
    arm = Arm()
    arm.reset(np.full(7, 0.3) * [1, 1, 1, -4, 1, 4, 1])
    drawn = urdf.shapes(arm)
    placed = np.array([urdf.shape_pose(arm, shape)[:3] for shape in drawn])
    assert {shape.kind for shape in drawn} == {'box', 'cylinder', 'sphere'}
    solid = [i for i in range(arm.model.ngeom) if arm.model.geom_bodyid[i] > 0]
    for i in solid:
        assert np.linalg.norm(placed - arm.data.geom_xpos[i], axis=1).min() < 1e-12
    # Both round ends of each capsule.
    capsules = sum(arm.model.geom_type[i] == mujoco.mjtGeom.mjGEOM_CAPSULE for i in solid)
    assert sum(shape.kind == 'sphere' for shape in drawn) == 2 * capsules


ELSEWHERE = """<mujoco><worldbody><body name="foot" pos="0.1 0 0.5" quat="0 0 0 1">
    <joint name="j1" type="hinge" axis="0 0 1"/><geom type="box" size="0.05 0.05 0.1"/>
    <body name="tcp" pos="0.3 0 0"><joint name="j2" type="hinge" axis="0 1 0"/>
    <geom type="sphere" size="0.05"/><site name="tcp" pos="0 0 0.1"/></body></body></worldbody>
    <actuator><motor joint="j1" ctrlrange="-5 5"/><motor joint="j2" ctrlrange="-2 2"/></actuator>
    </mujoco>"""


def test_an_arm_that_stands_elsewhere_and_turns_at_its_foot_is_described_where_it_is(tmp_path):
    path = tmp_path / 'arm.xml'
    path.write_text(ELSEWHERE)
    arm = Arm(path)
    model, data = read_back(arm, frame='table')
    assert [model.joint(i).name for i in range(model.njnt)] == ['j1', 'j2']
    for posture in ([0.0, 0.0], [0.7, -0.4]):
        arm.reset(np.array(posture))
        data.qpos[:] = posture
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.body('tcp_').xpos, arm.measure().pose[:3], atol=1e-12)
    with pytest.raises(DataError, match="'foot' is not at the origin"):
        urdf.urdf(arm, 'foot')


def test_a_base_frame_may_be_a_body_above_the_first(tmp_path):
    path = tmp_path / 'arm.xml'
    path.write_text(ELSEWHERE.replace(
        '<body name="foot" pos="0.1 0 0.5" quat="0 0 0 1">',
        '<body name="base"><body name="fr3_link0"><body name="foot">').replace(
            '</body></body></worldbody>', '</body></body></body></body></worldbody>'))
    arm = Arm(path)
    model, data = read_back(arm, frame='fr3_link0')
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.body('tcp_').xpos, arm.measure().pose[:3], atol=1e-12)
    np.testing.assert_allclose(data.body('fr3_link0').xpos, 0.0)


def test_meshes_are_drawn_as_the_boxes_around_them(tmp_path):
    path = tmp_path / 'arm.xml'
    path.write_text(ELSEWHERE.replace('<worldbody>', '<asset><mesh name="wedge" vertex="0 0 0  '
                                      '0.2 0 0  0 0.1 0  0 0 0.3"/></asset><worldbody>').replace(
        '<geom type="sphere" size="0.05"/>', '<geom type="mesh" mesh="wedge" group="3"/>'))
    drawn = [shape for shape in urdf.shapes(Arm(path)) if shape.body == 2]
    assert [shape.kind for shape in drawn] == ['box']
    np.testing.assert_allclose(np.sort(drawn[0].size), [0.1, 0.2, 0.3], atol=0.05)


def test_links_take_the_name_of_the_base_frame():
    text = urdf.urdf(Arm(), 'left_link0')
    assert '<link name="left_link0">' in text and '<link name="left_tcp" />' in text
    other = urdf.urdf(Arm(), 'base')
    assert '<link name="base" />' in other and '<link name="link0">' in other


def test_what_urdf_cannot_say_is_refused(tmp_path):
    path = tmp_path / 'arm.xml'
    path.write_text("""<mujoco><worldbody><body name="a"><body name="b" pos="0 0 1">
        <joint name="j" type="hinge" pos="0.1 0 0"/><geom size="0.1"/>
        <site name="tcp"/></body></body></worldbody>
        <actuator><motor joint="j" ctrlrange="-1 1"/></actuator></mujoco>""")
    with pytest.raises(DataError, match=r"b: URDF describes one hinge .* \['j'\]"):
        urdf.urdf(Arm(path))
