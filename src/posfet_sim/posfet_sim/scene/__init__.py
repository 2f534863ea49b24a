"""Scenes: objects that touch a simulated board over time (docs/scenes.md)."""

from posfet_sim.scene.scene import ChipBend, ObjectState, Scene, SceneObject
from posfet_sim.scene.scene_file import DEFAULT_SCENE, SCENE_FOLDER, load_scene
from posfet_sim.scene.scene_loads import SceneLoads
from posfet_sim.scene.trajectories import Keyframes

__all__ = [
    "DEFAULT_SCENE",
    "SCENE_FOLDER",
    "ChipBend",
    "Keyframes",
    "ObjectState",
    "Scene",
    "SceneLoads",
    "SceneObject",
    "load_scene",
]
