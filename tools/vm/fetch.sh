#!/usr/bin/env bash
# Prepares in .vm/ what `make test-vm` boots: Debian's kernel, unpacked and not installed, and modules built for it.
# Needs Debian's packages once; with what is already there, no network.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
cache=$PWD/.vm
source tools/vm/common.sh

tools=(qemu-system-x86_64 qemu-system-x86 busybox busybox-static cpio cpio depmod kmod ip iproute2 xz xz-utils gcc gcc make make)

install_tools() { # pairs of command and apt package
    local missing=()
    while (($#)); do
        command -v "$1" >/dev/null || missing+=("$2")
        shift 2
    done
    if command -v busybox >/dev/null && ldd "$(command -v busybox)" &>/dev/null; then missing+=(busybox-static); fi
    ((${#missing[@]})) || return 0
    ((EUID == 0)) || fail "packages are missing. Install with: sudo apt-get install --no-install-recommends ${missing[*]}"
    apt-get update -qq
    DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}"
}

dependency_of() { # first dependency of a package whose name begins so
    apt-cache depends "$1" 2>/dev/null | awk -v begin="$2" '$1 == "Depends:" && index($2, begin) == 1 { print $2; exit }'
}

unpack() { # Debian packages, into $kernel_root
    echo "posfet: fetching $*"
    (cd "$download" && apt-get download -qq "$@" 2>"$download/errors") || fail "apt-get download $*: $(head -n 1 "$download/errors")"
    local package
    for package in "$download"/*.deb; do dpkg -x "$package" "$kernel_root"; done
    rm -f "$download"/*.deb
}

build_modules() { # folder with a Kbuild file, log file
    make -s -C "$headers" M="$1" modules >"$2" 2>&1
}

install_tools "${tools[@]}"
sources=$(cat tools/vm/fetch.sh tools/vm/modules/* | sha256sum)
[[ -e $cache/ready && $(cat "$cache/sources" 2>/dev/null) == "$sources" ]] && exit 0

[[ $(uname -m) == x86_64 ]] || fail "x86-64 is needed, this is $(uname -m)"
image=$(dependency_of linux-image-amd64 linux-image-)
if [[ -z $image ]] && ((EUID == 0)); then
    apt-get update -qq
    image=$(dependency_of linux-image-amd64 linux-image-)
fi
[[ -n $image ]] || fail "apt knows no package linux-image-amd64: run apt-get update on Debian, or use a container of debian:12"

rm -rf "$cache"
kernel_root=$cache/kernel
download=$cache/download
mkdir -p "$kernel_root" "$download" "$cache/modules"
release=${image#linux-image-}
headers=$kernel_root/usr/src/linux-headers-$release
unpack "$image" "linux-headers-$release" "linux-headers-${release%-amd64}-common" "$(dependency_of "linux-headers-$release" linux-kbuild-)"
drivers=$kernel_root/lib/modules/$release/kernel/drivers # most of the size; of these only virtio and CAN are used
find "$drivers" "$drivers/net" -mindepth 1 -maxdepth 1 ! -name virtio ! -name net ! -name can -exec rm -rf {} +
depmod -b "$kernel_root" "$release"
sed -i "s|/usr/src/|$kernel_root/usr/src/|" "$headers/Makefile"

cp -r tools/vm/modules "$cache/build"
build_modules "$cache/build" "$cache/build.log" || fail "cannot build tools/vm/modules: $(grep -m 1 -i error "$cache/build.log"), see $cache/build.log"
cp "$cache/build"/*.ko "$cache/modules"

# Not in Debian's kernels: the driver of QEMU's CAN FD controller is built from the package with the kernel's source, of
# which only its folder is kept. Without it the tests on that controller are skipped.
if source_package=$(dependency_of linux-source linux-source-) && [[ -n $source_package ]]; then
    echo "posfet: building ctucanfd from $source_package"
    mkdir "$cache/ctucanfd"
    if (cd "$download" && apt-get download -qq "$source_package" 2>errors &&
        dpkg-deb --fsys-tarfile ./*.deb | tar -xO --wildcards './usr/src/linux-source-*.tar.xz' |
        tar -xJ -C "$cache/ctucanfd" --strip-components=5 --wildcards '*/drivers/net/can/ctucanfd/*') &&
        printf 'obj-m := ctucanfd.o ctucanfd_pci.o\nctucanfd-y := ctucanfd_base.o\n' >"$cache/ctucanfd/Kbuild" &&
        build_modules "$cache/ctucanfd" "$cache/ctucanfd.log"; then
        cp "$cache/ctucanfd"/*.ko "$cache/modules"
    else
        echo "posfet: no module ctucanfd: tests on CAN FD controllers are skipped" >&2
    fi
fi
rm -rf "$download" "$cache/build" "$cache/ctucanfd" "${kernel_root:?}/usr/src" "${kernel_root:?}/usr/lib" "${kernel_root:?}/usr/share"
echo "$sources" >"$cache/sources"
echo "$release" >"$cache/ready"
