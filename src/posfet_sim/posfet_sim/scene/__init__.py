"""Scenes: what touches a simulated board over time (docs/scenes.md)."""

from posfet_sim.scene.scene import ChipBend, ObjectState, Scene, SceneObject
from posfet_sim.scene.scene_file import DEFAULT_SCENE, SCENE_FOLDER, load_scene
from posfet_sim.scene.scene_loads import SceneLoads
from posfet_sim.scene.trajectories import Track

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
