#!/usr/bin/env bash
# Runs a command, as root, in a virtual machine with Debian's kernel and CAN controllers: tools/vm/run.sh python3 -m pytest
# Software emulation, no network, no disk image; the files are those of this machine and cannot be changed.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
source tools/vm/common.sh
[[ -e .vm/ready ]] || fail "run tools/vm/fetch.sh first"
((EUID == 0)) || echo "posfet: test-vm: not root, so files that only root may read are missing in the machine" >&2
release=$(<.vm/ready)
kernel=$PWD/.vm/kernel
time_limit=${POSFET_VM_TIME_LIMIT:-1200} # [s]

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$work/ram"/{bin,modules,host,overlay,root,proc,sys,dev}
cp "$(command -v busybox)" "$work/ram/bin/busybox"
cp tools/vm/init "$work/ram/init"
echo "$PWD" >"$work/ram/checkout"
cat >"$work/ram/command" <<COMMAND
set -e
export PATH=/usr/local/bin:/usr/bin:/bin:/usr/sbin:/sbin HOME=/tmp TERM=dumb LANG=C.UTF-8 PYTHONDONTWRITEBYTECODE=
export POSFET_VM_MODULES=$PWD/.vm/modules
mkdir -p /lib/modules
mount --bind $kernel/lib/modules /lib/modules
ip link set lo up
cd $PWD
source tools/environment.sh
$(printf '%q ' "$@")
COMMAND
number=100
while read -r module; do
    number=$((number + 1))
    name=$work/ram/modules/$number-$(basename "$module")
    if [[ $module == *.xz ]]; then xz -dc "$module" >"${name%.xz}"; else cp "$module" "$name"; fi
done < <(for name in virtio_pci 9pnet_virtio 9p overlay; do
    modprobe -d "$kernel" -S "$release" --show-depends "$name"
done | awk '$1 == "insmod" && !seen[$2]++ { print $2 }')
(cd "$work/ram" && find . | cpio --quiet -o -H newc | gzip -1) >"$work/ram.gz"

# Two SJA1000 controllers (classic CAN) on one wire, two CTU CAN FD controllers on another.
timeout "$time_limit" qemu-system-x86_64 -accel tcg,thread=multi -cpu Nehalem -smp 2 -m 1536 -nic none -display none -monitor none \
    -no-reboot -serial stdio -serial "file:$work/exit_code" \
    -kernel "$kernel/boot/vmlinuz-$release" -initrd "$work/ram.gz" -append "console=ttyS0 quiet panic=-1 mitigations=off" \
    -virtfs local,path=/,mount_tag=host,security_model=none,readonly=on,multidevs=remap \
    -object can-bus,id=wire0 -device kvaser_pci,canbus=wire0 -device kvaser_pci,canbus=wire0 \
    -object can-bus,id=wire1 -device ctucan_pci,canbus0=wire1,canbus1=wire1 </dev/null ||
    fail "the machine did not end by itself within $time_limit s"
exit_code=$(tr -cd '0-9' <"$work/exit_code")
exit "${exit_code:-1}"
