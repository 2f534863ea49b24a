"""Scenes: what touches a simulated board over time (docs/scenes.md)."""

from posfet_driver.scene.loads import SceneLoads
from posfet_driver.scene.model import ChipBend, ObjectState, Scene, SceneObject
from posfet_driver.scene.paths import Track
from posfet_driver.scene.read import DEFAULT_SCENE, SCENE_FOLDER, load_scene

__all__ = [
    "DEFAULT_SCENE",
    "SCENE_FOLDER",
    "ChipBend",
    "ObjectState",
    "Scene",
    "SceneLoads",
    "SceneObject",
    "Track",
    "load_scene",
]
