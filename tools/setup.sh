#!/usr/bin/env bash
# Prepares the environment in which the stack is built and run. With a sourced ROS 2: checks that its packages are
# installed. Without one: makes .venv with ROS 2 Jazzy, NumPy, python-can and colcon, pinned in tools/requirements.txt.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

readonly UV=0.13.9 # installs the packages in a fifth of pip's time

fail() {
    printf 'posfet: %s\n' "$@" >&2
    exit 1
}

require_tools() { # pairs of command and apt package
    local missing=() packages=()
    while (($#)); do
        command -v "$1" >/dev/null || { missing+=("$1"); packages+=("$2"); }
        shift 2
    done
    ((${#missing[@]} == 0)) || fail "missing: ${missing[*]}. Install with: sudo apt-get install ${packages[*]}"
}

require_python_modules() { # pairs of module and apt package
    local missing=() packages=()
    while (($#)); do
        python3 -c "import $1" 2>/dev/null || { missing+=("$1"); packages+=("$2"); }
        shift 2
    done
    ((${#missing[@]} == 0)) ||
        fail "missing Python modules: ${missing[*]}. Install with: sudo apt-get install ${packages[*]}"
}

supported() { "$1" -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null; }

find_python() {
    local candidate
    for candidate in ${PYTHON:-python3 python3.13 python3.12 python3.11 python3.10}; do
        if command -v "$candidate" >/dev/null && supported "$candidate"; then
            # Not the one of .venv, where that is active: it is removed below.
            "$candidate" -c 'import sys; print(sys._base_executable)'
            return
        fi
    done
    fail "Python 3.10 to 3.13 is needed${PYTHON:+ (PYTHON=$PYTHON is not one)}. Install with: sudo apt-get install python3 python3-venv, or name one: make PYTHON=/path/to/python3"
}

setup_sourced_ros() {
    require_tools colcon python3-colcon-common-extensions cmake cmake g++ g++
    # Its headers include Python's, which are in no folder that the compiler searches by itself. pip's are in one that it names.
    local includes
    includes="-I$(python3 -c 'import sysconfig; print(sysconfig.get_path("include"))') $(python3 -m pybind11 --includes 2>/dev/null || true)"
    # shellcheck disable=SC2086  # several options
    g++ -x c++ -fsyntax-only $includes -include pybind11/pybind11.h /dev/null 2>/dev/null ||
        fail "missing: headers of pybind11 and of Python. Install with: sudo apt-get install pybind11-dev python3-dev"
    require_python_modules rclpy "ros-$ROS_DISTRO-rclpy" can python3-can numpy python3-numpy yaml python3-yaml \
        rich python3-rich pytest python3-pytest
    echo "posfet: using the sourced ROS 2 $ROS_DISTRO"
}

install_requirements() {
    # Without this the start-up hook of the wheels would start every process of .venv's Python twice.
    export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1
    local pip=(.venv/bin/python -m pip install --quiet --disable-pip-version-check) quiet=--quiet
    [[ ! -t 2 ]] || quiet= # it draws bars
    "${pip[@]}" "uv==$UV"
    # shellcheck disable=SC2086  # no option, or one
    .venv/bin/uv pip install $quiet --python .venv/bin/python --override tools/uv_overrides.txt \
        --requirement tools/requirements.txt ||
        { # it does not read pip's configuration: another index, for instance
            echo "posfet: uv has failed, as the lines above say: pip installs the packages, which takes some minutes"
            "${pip[@]}" --requirement tools/requirements.txt
        }
}

setup_venv() {
    [[ "$(uname -sm)" == "Linux x86_64" ]] ||
        fail "without a sourced ROS 2 this needs Linux on x86-64, this is $(uname -sm). Source a ROS 2 first."
    require_tools git git make make gcc gcc g++ g++ cmake cmake
    local python
    python=$(find_python)
    "$python" -c 'import ensurepip, venv' 2>/dev/null ||
        fail "$python cannot make virtual environments. Install with: sudo apt-get install python3-venv"
    "$python" -c 'import os, sysconfig, sys; sys.exit(not os.path.exists(sysconfig.get_path("include") + "/Python.h"))' ||
        fail "$python has no headers to compile modules for it. Install with: sudo apt-get install python3-dev"

    local started=$SECONDS
    echo "posfet: first start: sets up .venv (about 250 MB to download), builds six packages, then runs; some minutes, once"
    echo "posfet: set-up [1/3] virtual environment .venv with $("$python" --version)"
    rm -rf .venv
    "$python" -m venv .venv
    echo "posfet: set-up [2/3] packages of tools/requirements.txt"
    install_requirements
    echo "posfet: set-up [3/3] paths of the ROS 2 wheels"
    .venv/bin/python tools/relocate.py
    cp tools/venv_setup.bash .venv/local_setup.bash
    echo "posfet: set up in $((SECONDS - started)) s"
    touch .venv/.ready
}

if [[ -n "${ROS_DISTRO:-}" ]]; then setup_sourced_ros; else setup_venv; fi
