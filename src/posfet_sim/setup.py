# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

from setuptools import find_packages, setup

package_name = "posfet_sim"

setup(
    name=package_name,
    version="0.2.0",
    packages=find_packages(exclude=["test", "test.*"]),
    package_data={package_name: ["py.typed", "scene/scenes/*.yaml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package_name}"]),
        (f"share/{package_name}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    author="posfet maintainers",
    author_email="maintainers@posfet.invalid",
    url="https://posfet.invalid",
    maintainer="posfet maintainers",
    maintainer_email="maintainers@posfet.invalid",
    description="Simulated readout board of POSFET tactile arrays: scenes, emulation, recording, scores.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "sim_board_node = posfet_sim.ros.start:sim_board_node",
            "replay_node = posfet_sim.ros.start:replay_node",
        ]
    },
)
