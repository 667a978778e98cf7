"""The arm's own body: distances as MuJoCo has them, rows as their derivative, and what they do."""
import mujoco
import numpy as np
import pytest

from experiments.control_limits import diagonal, make
from gdmp_ros.control.limit_rows import approach, row_name
from gdmp_ros.control.own_body import (
    body_rows,
    CAPSULE_SIZE,
    clearances,
    KEEP,
    nearest_points,
    push_apart,
)
from gdmp_ros.control.target import resting_target
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.chain import body_of
from test.control.formulas import too_near


def postures(arm, rng, count):
    return rng.uniform(arm.limits.lower, arm.limits.upper, (count, len(arm.home)))


@pytest.mark.parametrize('kind', ['any', 'parallel', 'crossing', 'point'])
def test_the_nearest_points_of_segments(kind, rng):
    near, far, along = np.empty(3), np.empty(3), np.linspace(0.0, 1.0, 201)[:, None]
    for _ in range(50):
        a, b, c, d = rng.normal(size=(4, 3))
        if kind == 'parallel':
            d = c + rng.uniform(-2.0, 2.0) * (b - a)
        elif kind == 'crossing':
            c, d = a + 0.3 * (b - a) - (d - c), a + 0.3 * (b - a) + (d - c)
        elif kind == 'point':
            d = c.copy()
        nearest_points(a, b, c, d, near, far)
        first, second = a + along * (b - a), c + along * (d - c)
        wanted = np.linalg.norm(first[:, None] - second[None], axis=2).min()
        # Samples of the segments are this far apart at most.
        coarse = 0.005 * (np.linalg.norm(b - a) + np.linalg.norm(d - c))
        assert wanted - coarse <= np.linalg.norm(far - near) <= wanted + 1e-9
        for point, begin, end in ((near, a, b), (far, c, d)):
            away = np.linalg.norm(point - begin) + np.linalg.norm(point - end)
            assert away == pytest.approx(np.linalg.norm(end - begin), abs=1e-9)


def test_distances_are_those_of_mujoco(rng):
    arm = Arm()
    model, data, body = arm.known.model, mujoco.MjData(arm.known.model), arm.shape
    capsule, checked = int(mujoco.mjtGeom.mjGEOM_CAPSULE), 0
    geoms = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom]]
    solid = [geom for geom in geoms if model.geom_contype[geom]
             or model.body(model.geom_bodyid[geom]).name == 'link0']
    assert len(solid) == len(body.capsules)
    for posture in postures(arm, rng, 30):
        data.qpos[:] = posture
        mujoco.mj_kinematics(model, data)
        found = clearances(arm.chain, body, posture)
        for distance, (a, b) in zip(found, body.pairs.astype(int)):
            first, second = solid[a], solid[b]
            if model.geom_type[first] == model.geom_type[second] == capsule and distance > 0.0:
                wanted = mujoco.mj_geomDistance(model, data, first, second, 5.0, None)
                assert distance == pytest.approx(wanted, abs=1e-6)
                checked += 1
    assert checked > 200


@pytest.mark.parametrize('words', [('',), ('fr3', 'flange', False)])
def test_a_row_is_the_derivative_of_the_distance(words, rng):
    arm = Arm(*words)
    body, n = arm.shape, len(arm.home)
    k, h, steepest = len(body.pairs), 1e-6, 0.0
    for posture in postures(arm, rng, 20):
        before = clearances(arm.chain, body, posture)
        rows, bounds, ids = np.zeros((k, n)), np.zeros(k), np.zeros(k)
        count = body_rows(*arm.chain, posture, body.capsules, body.pairs, 5.0, 100.0, 0, rows,
                          bounds, ids, 0)
        for row, bound, pair in zip(rows[:count], bounds, ids.astype(int)):
            assert bound == approach(before[pair] - KEEP, 5.0)
            for j in range(n):
                moved = posture.copy()
                moved[j] += h
                rate = (clearances(arm.chain, body, moved)[pair] - before[pair]) / h
                # Where the nearest point is about to jump to another end the distance has a bend.
                if abs(-row[j] - rate) > 1e-4:
                    moved[j] -= 2.0 * h
                    back = (before[pair] - clearances(arm.chain, body, moved)[pair]) / h
                    assert min(rate, back) - 1e-4 <= -row[j] <= max(rate, back) + 1e-4
            steepest = max(steepest, np.abs(row).max())
    assert steepest > 0.1


def test_only_what_is_too_near_is_pushed_apart_and_not_at_once():
    arm = Arm()
    body, n = arm.shape, len(arm.home)
    torque, none = np.zeros(n), np.zeros(len(body.pairs))
    folded = too_near(arm)
    push_apart(*arm.chain, arm.home, np.zeros(n), body.capsules, body.pairs, none.copy(), torque)
    assert not torque.any()
    deep = np.maximum(KEEP - clearances(arm.chain, body, folded), 0.0)
    push_apart(*arm.chain, folded, np.zeros(n), body.capsules, body.pairs, deep.copy(), torque)
    assert np.abs(torque).max() < 1e-9  # it began there
    push_apart(*arm.chain, folded, np.zeros(n), body.capsules, body.pairs, none.copy(), torque)
    step = folded + 1e-3 * torque / np.linalg.norm(torque)
    assert clearances(arm.chain, body, step).min() > clearances(arm.chain, body, folded).min()


def test_pairs_that_touch_at_home_and_neighbours_may_touch():
    spec = mujoco.MjSpec.from_string("""
        <mujoco><worldbody><body name='a'><geom type='capsule' fromto='0 0 0 0 0 1' size='0.1'/>
        <body name='b' pos='0 0 1'><joint axis='1 0 0'/><geom type='box' size='0.1 0.1 0.2'/>
        <body name='c' pos='0 0 0.5'><joint axis='1 0 0'/><geom type='sphere' size='0.1'/>
        <body name='d' pos='0 0 0.5'><joint axis='1 0 0'/><geom type='sphere' size='0.1'/>
        <geom type='cylinder' fromto='0 0 -1 0 0 -0.9' size='0.05'/>
        <site name='tcp'/></body></body></body></body></worldbody></mujoco>""")
    model = spec.compile()
    body = body_of(model, model.body('d').id, np.zeros(3))
    assert body.capsules.shape == (5, CAPSULE_SIZE)
    # The cylinder of d is inside of the capsule of a.
    assert body.names == ('d and a',)
    assert row_name(2 * 3 + 7, 3, body.names) == 'the body of the arm itself (d and a)'


@pytest.mark.parametrize('plant', ['clean', pytest.param('real', marks=pytest.mark.long)])
def test_joints_whose_reference_leads_the_arm_into_itself_stop_before(plant):
    loop = make(plant)
    arm, body, nearest = loop.arm, loop.arm.shape, np.inf
    home, named = arm.home.copy(), False
    folded = np.array([0.0, -1.2, 0.0, -3.0, 0.0, 0.3, 0.785])
    assert clearances(arm.chain, body, folded).min() < 0.0
    for k in range(5000):
        place = home + min(k / 3000.0, 1.0) * (folded - home)
        rate = (folded - home) / 3.0 if k < 3000 else np.zeros(7)
        loop.must_follow(np.concatenate([place, rate, np.full(7, 300.0), [0.7]]))
        here = loop.tick().measurement.position
        named = named or 'itself' in loop.controller.blocked
        nearest = min(nearest, clearances(arm.chain, body, here).min())
    assert nearest > 0.5 * KEEP and named


def test_an_arm_that_is_too_near_itself_is_not_moved_by_that():
    loop = make('clean')
    loop.arm.reset(too_near(loop.arm))
    loop.hold(loop.arm.measure())
    begin = loop.arm.measure().pose.copy()
    for _ in range(1000):
        loop.must_follow(resting_target(begin, diagonal(400.0)))
        tick = loop.tick()
    assert np.linalg.norm(tick.measurement.pose[:3] - begin[:3]) < 1e-3
