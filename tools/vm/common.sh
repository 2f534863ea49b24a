# shellcheck shell=bash
# Sourced by the other scripts of this folder.
PATH=$PATH:/usr/sbin:/sbin
fail() {
    printf 'posfet: test-vm: %s\n' "$@" >&2
    exit 1
}
