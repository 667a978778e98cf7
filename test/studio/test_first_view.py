"""What is seen at first: the path, its goal and the arm, for skills of any size and place."""
from io import BytesIO

import numpy as np
from PIL import Image
import pytest

from gdmp_ros import Demonstration, Skill
from gdmp_ros.data.gallery import learned
from gdmp_ros.manifolds.poses import tool_manifold
from gdmp_ros.sim.arm import Arm
from gdmp_ros.studio.first_view import first_view
from gdmp_ros.studio.motion import of_skill
from gdmp_ros.studio.scene import COVERED
from gdmp_ros.util.profiles import minimum_jerk
from test.studio.browser import needs_browser, opened_browser, Page, StudioProcess

#: Width and height of the picture, without the panel at the side; share that a panel covers below.
PICTURES = {'large': (1040, 900, 0.0), 'small': (624, 700, 0.0), 'phone': (390, 844, COVERED)}


def arc(start, away, turn):
    """A motion on an arc, of any size."""
    shares = minimum_jerk(np.linspace(0.0, 1.0, 200))[:, None]
    path = start + shares * away + np.sin(np.pi * shares) * turn
    poses = np.column_stack([path, np.tile([0.0, 1.0, 0.0, 0.0], (200, 1))])
    return Skill.learn(Demonstration(np.linspace(0.0, 2.0, 200), poses, tool_manifold(None)))


SKILLS = {
    'a letter': lambda: learned('letter-G'), 'pick and place': lambda: learned('pick-and-place'),
    'polishing': lambda: learned('polish'),
    'small, in front': lambda: arc(np.array([0.45, 0.0, 0.4]), np.array([0.04, 0.03, 0.0]),
                                   np.array([0.0, 0.0, 0.02])),
    'large, to the side': lambda: arc(np.array([0.1, -0.6, 0.3]), np.array([0.4, 0.5, 0.3]),
                                      np.array([0.0, 0.1, 0.2]))}


@pytest.mark.parametrize('name', SKILLS)
@pytest.mark.parametrize('size', PICTURES)
def test_the_path_fills_half_of_the_picture_and_goal_and_arm_are_in_it(name, size):
    skill = SKILLS[name]()
    path = of_skill(skill).poses[:, :3]
    width, height, covered = PICTURES[size]
    view = first_view(path, width / height, covered)
    # The height is what the camera knows; the part that is not covered is higher up.
    free = np.array([width, (1.0 - covered) * height])

    def seen(points):
        return view.projected(points) * 0.5 * height - [0.0, 0.5 * covered * height]
    shown = seen(path)
    assert np.ptp(shown, axis=0).max() >= 0.5 * free.min()
    assert (np.abs(shown) <= 0.5 * free).all()
    # The tool of the arm at the start of the skill.
    arm = Arm()
    posture = arm.chain.near(skill.start[:7], arm.home, arm.end_pose)
    arm.reset(posture)
    bodies = [arm.data.xpos[body] for body in range(1, arm.model.nbody)]
    assert (np.abs(seen(np.array(bodies))) <= 0.5 * free).all(axis=1).any()


def test_without_a_motion_the_arm_is_seen():
    for nothing in (None, np.zeros((5, 3))):
        view = first_view(nothing)
        tool = view.projected(Arm().pose_at(Arm().home)[None, :3])
        assert np.abs(tool).max() < 0.5


@needs_browser
def test_a_browser_shows_the_goal_where_the_view_has_it(tmp_path):
    skill = arc(np.array([0.45, 0.0, 0.4]), np.array([0.04, 0.03, 0.0]), np.array([0, 0, 0.02]))
    skill.save(tmp_path / 'small.json')
    process = StudioProcess('small.json', cwd=tmp_path)
    try:
        with opened_browser() as browser:
            page = Page(browser, process.address, skill)
            page.wait('the path', lambda text: 'ends at' in text or None)
            page.step(10)
            picture = np.asarray(Image.open(BytesIO(page.page.screenshot())).convert('RGB'), int)
            red, green, blue = np.moveaxis(picture, 2, 0)
            # The start is marked by an orange ball; the goal has a handle over its own.
            rows, columns = np.nonzero((red > 150) & (red - blue > 100) & (red - green > 50)
                                       & (green > 50))
            x, y = page.pixel(skill.start[:3])
            assert np.hypot(columns - x, rows - y).min() < 15.0
            page.check_clean()
    finally:
        process.end()
