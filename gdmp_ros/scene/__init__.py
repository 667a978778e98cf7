"""What stands around an arm: volumes, the distances from them, ways around them."""
from gdmp_ros.scene.scene import read_scene, Scene, write_scene
from gdmp_ros.scene.volume import Volume

__all__ = ['Scene', 'Volume', 'read_scene', 'write_scene']
