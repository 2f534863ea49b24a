#!/usr/bin/env bash
# Checks the sources of the compiled path with clang-tidy, in the environment of tools/environment.sh. Most of the time
# goes to headers, pybind11's above all: the bindings of a module, and the other sources of a folder, are read as one
# file that includes them. So names that are local to a file are unique among those; and what is seen no longer is a
# header that a file does not include (`make sanitize` compiles all but the bindings one by one), nor a name of another
# namespace that is declared and not used.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
core=src/posfet_core
folder=build/tidy
rm -rf "$folder"
mkdir -p "$folder"

together() { # name of the file that includes all whose names are read
    sed 's/.*/#include "&"  \/\/ NOLINT(bugprone-suspicious-include)/' >"$folder/$1.cpp"
}

sources=$(find "$core/src" -name '*.cpp' | LC_ALL=C sort)
bindings='/(python_|module)[^/]*$'
grep -E "$bindings" <<<"$sources" | grep -v "^$core/src/protocol/" | together 1_bindings_of_scan_path
grep -E "$bindings" <<<"$sources" | grep "^$core/src/protocol/" | together 2_bindings_of_protocol
for each in $(grep -vE "$bindings" <<<"$sources" | xargs -n 1 dirname | sort -u); do
    grep -E "^$each/[^/]*$" <<<"$sources" | grep -vE "$bindings" | together "3_$(basename "$each")"
done

options=(-std=c++17 -I. "-I$core/include" -isystem "$(python3 -c 'import sysconfig; print(sysconfig.get_path("include"))')")
pybind11=$(python3 -c 'import pybind11; print(pybind11.get_include())' 2>/dev/null || true)
[[ -z "$pybind11" ]] || options+=(-isystem "$pybind11")
# The longest first
printf '%s\n' "$folder"/*.cpp | xargs -P "$(nproc)" -I FILE clang-tidy --quiet --config-file="$core/.clang-tidy" FILE -- "${options[@]}"
