#!/usr/bin/env bash
# Builds the workspace with colcon into build/ and install/, with the sourced ROS 2 or with .venv.
set -eo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source=tools/venv_setup.bash
[[ -n "${ROS_DISTRO:-}" ]] || source .venv/local_setup.bash
# Without a limit of their own, make's processes wait while others load the machine.
[[ "${MAKEFLAGS:-}" == *-j* ]] || MAKEFLAGS="-j$(nproc)"
export MAKEFLAGS
packages=(src/*/package.xml)
# Ninja, which is in .venv, takes a sixth less processor time for the messages than make. A build folder is of one of the two.
generator="Unix Makefiles"
command -v ninja >/dev/null && generator=Ninja
export NINJA_STATUS="[%p] "
for cache in build/*/CMakeCache.txt; do
    [[ ! -e "$cache" ]] || grep -q "^CMAKE_GENERATOR:INTERNAL=$generator$" "$cache" || rm -rf "${cache%/*}"
done
# The generators of the messages parse each interface file once.
export PYTHONPATH="$PWD/tools/parse_once${PYTHONPATH:+:$PYTHONPATH}" POSFET_PARSED="$PWD/build/parsed"
# .venv has no C++ client library.
only_python=$([[ -n "${ROS_DISTRO:-}" ]] && echo OFF || echo ON)
# Compile the installed modules now, whatever the caller has set, instead of at each start.
env -u PYTHONDONTWRITEBYTECODE colcon build \
    --event-handlers console_direct+ console_start_end+ console_stderr- console_cohesion- status- summary- \
    --cmake-args -G "$generator" "-DPython3_EXECUTABLE=$(command -v python3)" -DBUILD_TESTING=OFF "-DPOSFET_MSGS_ONLY_PYTHON=$only_python" --no-warn-unused-cli |
    python3 tools/progress.py "${#packages[@]}"
touch install/.built
