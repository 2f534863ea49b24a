"""Dependencies go one way, and ROS stays in the files that are named for it."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

from each_row import each_row

SOURCES = Path(__file__).parent.parent / "src"
LAYERS = ["posfet_msgs", "posfet_model", "posfet_driver", "posfet"]
"""From the lowest to the highest: each may import those before it."""
ROS_FILES = ("_node.py", "conversions.py", "ros_parameters.py")
ROS_PACKAGES = {"rclpy", "rcl_interfaces", "builtin_interfaces", "tf2_ros", "launch", "launch_ros"} | {
    f"{name}_msgs" for name in ("std", "geometry", "sensor", "diagnostic", "visualization", "lifecycle", "posfet")
}

FILES = sorted(path for layer in LAYERS for path in (SOURCES / layer / layer).rglob("*.py"))


def imported(path: Path) -> set[str]:
    """Return the top-level packages that a file imports, anywhere in it."""
    packages = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            packages |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            packages.add(node.module.split(".")[0])
    return packages


def test_there_are_files() -> None:
    assert len(FILES) > 20


def test_ros_is_imported_only_where_it_may_be() -> None:
    with each_row() as row:
        for path in FILES:
            if not path.name.endswith(ROS_FILES):
                with row(str(path.relative_to(SOURCES))):
                    assert not imported(path) & ROS_PACKAGES


def test_dependencies_go_one_way() -> None:
    with each_row() as row:
        for path in FILES:
            layer = LAYERS.index(path.relative_to(SOURCES).parts[0])
            with row(str(path.relative_to(SOURCES))):
                assert not imported(path) & set(LAYERS[layer + 1 :])


def test_files_stay_short() -> None:
    with each_row() as row:
        for path in FILES:
            with row(str(path.relative_to(SOURCES))):
                assert len(path.read_text(encoding="utf-8").splitlines()) <= 400


def test_the_model_loads_neither_ros_nor_matplotlib() -> None:
    modules = ["posfet_model.reconstruction", "posfet_model.transistor", "posfet_model.film", "posfet_model.follower"]
    program = f"import sys, {', '.join(modules)}; print(*sys.modules)"
    command = [sys.executable, "-c", program]
    result = subprocess.run(command, capture_output=True, text=True, check=True, cwd=SOURCES / "posfet_model")
    loaded = result.stdout.split()
    assert "posfet_model.film" in loaded
    assert not {"rclpy", "matplotlib", "scipy", "can"} & set(loaded)
