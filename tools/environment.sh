# shellcheck shell=bash
# Source this: the environment in which the built stack runs and is tested. A sourced ROS 2 is used as it is;
# otherwise the .venv that tools/setup.sh made stands in its place.
_posfet_root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
# shellcheck disable=SC1091
[[ -n "${ROS_DISTRO:-}" ]] || source "$_posfet_root/.venv/local_setup.bash"
# shellcheck disable=SC1091
source "$_posfet_root/install/setup.bash" ""
unset _posfet_root
# Nothing that is started here leaves this machine, unless the user asks for it.
export ROS_AUTOMATIC_DISCOVERY_RANGE="${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}"
