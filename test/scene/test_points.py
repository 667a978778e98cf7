"""Points as volumes: boxes around meshes and clouds, and what a sensor looks through."""
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from gdmp_ros import DataError
from gdmp_ros.manifolds.poses import compose
from gdmp_ros.manifolds.quaternion import UnitQuaternion
from gdmp_ros.scene import Scene, Volume
from gdmp_ros.scene.distance import distances
from gdmp_ros.scene.points import boxes_around, PointMap, volumes_around
from test.scene.camera import box, CAMERA, CELL, picture


def test_boxes_hold_all_cells_and_little_else(rng):
    cells = np.unique(rng.integers(0, 12, (200, 3)), axis=0)
    for most in (1, 3, 20):
        boxes = boxes_around(cells, most)
        assert 1 <= len(boxes) <= most
        inside = ((cells[:, None] >= boxes[None, :, :3])
                  & (cells[:, None] <= boxes[None, :, 3:])).all(axis=2)
        assert (inside.sum(axis=1) >= 1).all()
    # Two blocks and a plate are three boxes, without any other cell.
    blocks = [((0, 0, 0), (20, 20, 1)), ((2, 2, 1), (5, 5, 9)), ((12, 3, 1), (15, 9, 4))]
    cells = np.vstack([np.indices(np.subtract(high, low)).reshape(3, -1).T + low
                       for low, high in blocks])
    boxes = boxes_around(cells, 10)
    assert sorted(map(tuple, boxes)) == sorted(
        (*low, *np.subtract(high, 1)) for low, high in blocks)
    assert len(boxes_around(np.empty((0, 3)), 4)) == 0


def test_points_and_meshes_are_held_by_their_volumes(rng):
    points = rng.uniform(-0.2, 0.3, (100, 3))
    (one,) = volumes_around('cluster', points, most=1)
    assert one.name == 'cluster' and distances(one.packed(0.0, {}), points).max() < 1e-9
    several = volumes_around('cluster', points, most=4)
    assert [volume.name for volume in several] == [f'cluster#{k}' for k in range(1, 5)]
    assert distances(Scene(several).packed(), points).max() < 1e-9
    # The surface of a convex mesh that is turned: nothing of it is outside.
    corners = rng.normal(0.0, 0.1, (40, 3)) * [1.0, 2.0, 0.3]
    triangles, turn = ConvexHull(corners).simplices, UnitQuaternion().random_point(rng)
    pose = np.array([0.4, -0.1, 0.3, *turn])
    mesh = volumes_around('mesh', corners, triangles, pose=pose)
    share = rng.dirichlet(np.ones(3), 4000)
    surface = np.einsum('ki,kij->kj', share, corners[triangles[rng.integers(
        0, len(triangles), 4000)]])
    placed = np.array([compose(pose, np.array([*point, 1.0, 0.0, 0.0, 0.0]))[:3]
                       for point in surface])
    assert distances(Scene(mesh).packed(), placed).max() < 1e-3
    whole = volumes_around('mesh', corners, triangles, most=1)[0]
    assert 1 < len(mesh) <= 6
    assert sum(np.prod(volume.size) for volume in mesh) < 0.8 * np.prod(whole.size)
    for wrong, reason in (([[np.nan, 0.0, 0.0]], 'finite points'), ([], 'finite points')):
        with pytest.raises(DataError, match=reason):
            volumes_around('mesh', wrong)
    with pytest.raises(DataError, match='a corner that is no point'):
        volumes_around('mesh', corners, [[0, 1, 40]])


def test_what_a_camera_sees_is_held_by_few_boxes(rng):
    things = [box('crate', (0.5, 0.15, 0.1), (0.1, 0.1, 0.2)),
              box('post', (0.3, -0.3, 0.15), (0.05, 0.05, 0.3)),
              box('plate', (0.7, -0.1, 0.02), (0.2, 0.1, 0.04))]
    seen = PointMap(1.2, CELL, 3)
    points = picture(things, rng)
    assert seen.see(points, CAMERA) == len(points)
    found = Scene(seen.volumes(24))
    assert 4 <= len(found) <= 24
    base = points * [1.0, -1.0, -1.0] + CAMERA[:3]
    near = np.abs(base).max(axis=1) < 1.2 - CELL
    # Lonely points do not count, all others are held.
    assert np.mean(distances(found.packed(), base[near]) < 2e-3) > 0.999
    # Between the things there is room.
    free = np.array([[0.5, -0.2, 0.15], [0.3, 0.1, 0.2], [0.7, 0.1, 0.2]])
    assert distances(found.packed(), free).min() > 0.05
    names = {volume.name: volume.pose for volume in found}
    seen.see(picture(things, rng), CAMERA)
    for volume in seen.volumes(24):
        assert np.linalg.norm(names[volume.name][:3] - volume.pose[:3]) < 3 * CELL


def test_what_has_gone_is_free_after_some_clouds_and_what_is_hidden_stays(rng):
    crate, post = (box('crate', (0.5, 0.15, 0.1), (0.1, 0.1, 0.2)),
                   box('post', (0.3, -0.3, 0.15), (0.05, 0.05, 0.3)))
    seen, places = PointMap(1.2, CELL, 3), np.array([crate.pose[:3], post.pose[:3]])
    places[:, 2] = 0.18
    for _ in range(3):
        seen.see(picture([crate, post], rng), CAMERA)
    assert distances(Scene(seen.volumes(24)).packed(), places).max() < 0.03
    # A plate hides the post from the camera, and the crate has been taken away.
    hides = box('hides', (0.35, -0.15, 0.7), (0.3, 0.35, 0.02))
    seen.see(picture([post, hides], rng), CAMERA)
    assert distances(Scene(seen.volumes(24)).packed(), places).max() < 0.03
    for _ in range(8):
        seen.see(picture([post, hides], rng), CAMERA)
    crate_away, post_away = distances(Scene(seen.volumes(24)).packed(), places)
    assert crate_away > 0.05 and post_away < 0.03
    # Where the sensor is is not known: what is not shown is free after a while.
    points = picture([post], rng) * [1.0, -1.0, -1.0] + CAMERA[:3]
    blind = PointMap(1.2, CELL, 3)
    still = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    blind.see(points, still, looks=False)
    bare = points[points[:, 2] < 0.02]
    blind.see(bare, still, looks=False)
    assert distances(Scene(blind.volumes(24)).packed(), places[1:]).max() < 0.03
    for _ in range(4):
        blind.see(bare, still, looks=False)
    assert distances(Scene(blind.volumes(24)).packed(), places[1:]).min() > 0.1


def test_points_of_the_arm_and_of_known_volumes_do_not_count_but_erase_nothing(rng):
    arm = box('arm', (0.5, 0.15, 0.1), (0.06, 0.06, 0.2))
    capsules = np.array([[0.5, 0.15, 0.0, 0.5, 0.15, 0.2, 0.05]])
    floor = Volume('floor', 'plane', (), np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]))
    seen = PointMap(1.2, CELL, 3)
    seen.see(picture([arm], rng), CAMERA, capsules, Scene([floor]).packed(), 0.02)
    assert seen.volumes(24) == []
    # Something beside the arm stays while the arm comes nearer, so that it keeps away from it.
    thing = box('thing', (0.6, 0.15, 0.1), (0.04, 0.04, 0.2))
    seen.see(picture([arm, thing], rng), CAMERA, capsules, Scene([floor]).packed(), 0.02)
    before = Scene(seen.volumes(24))
    near = np.array([[0.5, 0.15, 0.0, 0.59, 0.15, 0.2, 0.06]])
    for _ in range(10):
        seen.see(picture([arm, thing], rng), CAMERA, near, Scene([floor]).packed(), 0.02)
    after = Scene(seen.volumes(24))
    assert len(before) > 0
    assert distances(after.packed(), [thing.pose[:3] + [0.0, 0.0, 0.09]])[0] < CELL
    # Points that are not finite are no points.
    broken = picture([thing], rng)
    broken[::2] = np.nan
    assert PointMap(1.2, CELL, 3).see(broken, CAMERA) == len(broken) // 2


def test_a_cloud_that_shows_nothing_makes_nothing_free(rng):
    thing = box('thing', (0.5, 0.1, 0.1), (0.1, 0.1, 0.2))
    points = picture([thing], rng) * [1.0, -1.0, -1.0] + CAMERA[:3]
    still = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    blind = PointMap(1.2, CELL, 3)
    blind.see(points, still, looks=False)
    for nothing in 4 * (np.empty((0, 3)), np.full((10, 3), np.nan)):
        assert blind.see(nothing, still, looks=False) == 0
    assert distances(Scene(blind.volumes(24)).packed(), thing.pose[None, :3] + [0, 0, 0.09]) < 0.03
