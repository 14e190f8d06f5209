#!/usr/bin/env bash
# Builds the kernel of `can_guest.py --virtual-time`: User Mode Linux from Debian's kernel source, with CAN and with a clock that
# stands while the guest computes, which Debian's own build leaves out.
#
#   deploy/guest/build_kernel.sh        140 MB to download; took 9 and 14 min on two CPUs in use
#
# Needs gcc, make, flex, bison and bc. The kernel is kept beside the guest's other programs, below ~/.cache/clutch-hil/uml.
set -euo pipefail
cache=${CLUTCH_HIL_CACHE:-$HOME/.cache/clutch-hil/uml}
source=linux-source-6.1 # the version of Debian's user-mode-linux, for which xstate.c is
for program in apt-get dpkg-deb gcc make flex bison bc xz; do
  if ! command -v "$program" >/dev/null; then
    echo "error: $program is missing: apt-get install gcc libc6-dev make flex bison bc xz-utils" >&2
    exit 2
  fi
done
mkdir -p "$cache"
work=$(mktemp -d "$cache/build-XXXXXX")
trap 'rm -rf "$work"' EXIT
cd "$work"
echo "1 of 3: download $source" >&2
apt-get -q download "$source" >&2
dpkg-deb -x "$source"_*.deb . && rm "$source"_*.deb
echo "2 of 3: unpack it" >&2
tar xf "usr/src/$source.tar.xz"
cd "$source"
make -s ARCH=um x86_64_defconfig
# what init.sh loads as modules is built in; time travel is what Debian's build lacks
scripts/config --enable UML_TIME_TRAVEL_SUPPORT --enable HOSTFS --enable OVERLAY_FS --enable DEVTMPFS \
  --enable TMPFS --enable TMPFS_XATTR --enable HIGH_RES_TIMERS --enable POSIX_MQUEUE --enable NETDEVICES --enable NET_SCHED --enable NET_SCH_TBF \
  --enable CAN --enable CAN_RAW --enable CAN_BCM --enable CAN_DEV --enable CAN_VCAN \
  --enable DEBUG_INFO_NONE --disable DEBUG_KERNEL
make -s ARCH=um olddefconfig
echo "3 of 3: build it" >&2
make -s ARCH=um -j"$(nproc)" linux
mv linux "$cache/linux.virtual-time"
echo "wrote $cache/linux.virtual-time"
