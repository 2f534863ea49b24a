# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

from glob import glob

from setuptools import find_packages, setup

package_name = "posfet_model"

setup(
    name=package_name,
    version="0.2.0",
    packages=find_packages(exclude=["test", "test.*"]),
    package_data={
        package_name: [
            "py.typed",
            "ros/*.xml",
            "spice/netlists/*",
            "sensor/sensors/*.yaml",
            "design/designs/*.yaml",
        ]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package_name}"]),
        (f"share/{package_name}", ["package.xml"]),
        # Where a robot's description finds them: $(find posfet_model)/sensors/posfet_5x5.yaml
        (f"share/{package_name}/sensors", sorted(glob(f"{package_name}/sensor/sensors/*.yaml"))),
    ],
    python_requires=">=3.10",
    install_requires=["setuptools", "numpy>=1.26", "PyYAML"],
    extras_require={"figures": ["matplotlib"], "test": ["pytest"]},
    zip_safe=False,
    author="posfet maintainers",
    author_email="maintainers@posfet.invalid",
    url="https://posfet.invalid",
    maintainer="posfet maintainers",
    maintainer_email="maintainers@posfet.invalid",
    description="Device physics, force reconstruction and contacts of POSFET tactile arrays.",
    license="Apache-2.0",
    entry_points={"console_scripts": ["model_node = posfet_model.ros.start:model_node"]},
)
