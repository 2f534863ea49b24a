#!/usr/bin/env bash
# Releases of the packages: tools/release.sh FOLDER writes a tarball for each, tools/release.sh FOLDER --check builds each
# alone, in a workspace of its own, on those of its dependencies. As bloom does, a tarball holds files in place of links.
# tools/release.sh --notes prints the notes of the version, for its tag: the newest section of each package's changelog.
set -eo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
[[ $# -ge 1 ]] || { echo "usage: tools/release.sh FOLDER [--check], or tools/release.sh --notes" >&2; exit 1; }
version=$(sed -n 's:.*<version>\(.*\)</version>.*:\1:p' src/posfet/package.xml)
packages=(posfet_msgs posfet_core posfet_model posfet_driver posfet_sim posfet) # each may depend on those before it

if [[ "$1" == --notes ]]; then
    echo "posfet $version"
    for package in "${packages[@]}"; do
        printf '\n%s\n\n' "$package"
        awk '/^[0-9]+[.][0-9.]+ \(/ { section++; next } section == 1 && NF && !/^-+$/' "src/$package/CHANGELOG.rst"
    done
    exit
fi
mkdir -p "$1"
folder=$(cd "$1" && pwd)

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
git archive HEAD | tar -x -C "$work"
for package in "${packages[@]}"; do
    tar --dereference --owner=0 --group=0 -czf "$folder/$package-$version.tar.gz" -C "$work/src" "$package"
    echo "$folder/$package-$version.tar.gz: written"
done
if grep -q '^WEBSITE = .*\.invalid"' tools/address.py; then
    echo "posfet: the address of the project is a placeholder: set it in tools/address.py before a release" >&2
fi
[[ "${2:-}" == --check ]] || exit 0

# shellcheck source=tools/venv_setup.bash
[[ -n "${ROS_DISTRO:-}" ]] || source .venv/local_setup.bash
for package in "${packages[@]}"; do
    mkdir -p "$work/$package/src"
    tar -xzf "$folder/$package-$version.tar.gz" -C "$work/$package/src"
    cd "$work/$package"
    colcon build --event-handlers status- --cmake-args "-DPython3_EXECUTABLE=$(command -v python3)" -DBUILD_TESTING=ON --no-warn-unused-cli
    # shellcheck disable=SC1091
    source install/setup.bash
    if [[ -n "${TEST:-}" ]]; then
        colcon test --return-code-on-test-failure --event-handlers console_direct+ --pytest-args -q --maxfail=5
    fi
    echo "posfet: $package-$version.tar.gz is whole"
done
