# shellcheck shell=bash
# Copied to .venv/local_setup.bash, where colcon and install/setup.bash look for it, so that .venv takes the place of
# /opt/ros/jazzy. The ROS 2 wheels have libraries in several folders, which go into the loader's path.
_posfet_venv=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
if [[ "${VIRTUAL_ENV:-}" != "$_posfet_venv" || -z "${_ROS_WHEELS_BOOTSTRAP_COMPLETE:-}" ]]; then
    export VIRTUAL_ENV="$_posfet_venv"
    export PATH="$_posfet_venv/bin:$PATH"
    export AMENT_PREFIX_PATH="$_posfet_venv${AMENT_PREFIX_PATH:+:$AMENT_PREFIX_PATH}"
    export CMAKE_PREFIX_PATH="$_posfet_venv${CMAKE_PREFIX_PATH:+:$CMAKE_PREFIX_PATH}"
    _posfet_libraries="$_posfet_venv/lib"
    for _posfet_folder in "$_posfet_venv"/lib/python3.*/site-packages/ros_*.libs; do
        _posfet_libraries+=":$_posfet_folder"
    done
    export LD_LIBRARY_PATH="$_posfet_libraries${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}"
    export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1 # paths are set: no second start of each Python by the wheels
    unset PYTHONHOME _posfet_folder _posfet_libraries
fi
unset _posfet_venv
