# shellcheck shell=bash
# Source this: the environment in which the built stack runs and is tested. Uses a sourced ROS 2 if there is one,
# otherwise the .venv made by tools/setup.sh.
_posfet_root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
# shellcheck disable=SC1091
[[ -n "${ROS_DISTRO:-}" ]] || source "$_posfet_root/.venv/local_setup.bash"
# shellcheck disable=SC1091
source "$_posfet_root/install/setup.bash" ""
unset _posfet_root
# ROS traffic stays on this machine unless the user sets another range.
export ROS_AUTOMATIC_DISCOVERY_RANGE="${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}"
