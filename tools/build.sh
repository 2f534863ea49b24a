#!/usr/bin/env bash
# Builds the workspace with colcon into build/ and install/, with the sourced ROS 2 or with .venv.
set -eo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=tools/venv_setup.bash
[[ -n "${ROS_DISTRO:-}" ]] || source .venv/local_setup.bash
# Without a limit of their own, make's processes wait while others load the machine.
[[ "${MAKEFLAGS:-}" == *-j* ]] || export MAKEFLAGS="-j$(nproc)"
# Compile the installed modules now, whatever the caller has set, instead of at each start.
env -u PYTHONDONTWRITEBYTECODE colcon build --event-handlers console_start_end+ console_cohesion- status- \
    --cmake-args "-DPython3_EXECUTABLE=$(command -v python3)" -DBUILD_TESTING=OFF --no-warn-unused-cli
touch install/.built
