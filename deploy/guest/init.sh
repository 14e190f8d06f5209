# First process of the CAN guest: modules, vcan0, then the run's command (can_guest.py starts it).
# $1 is the host folder of the run, which holds `tools` (a link to the unpacked Debian packages), `mounts.sh` and
# `command.sh`. Programs are called as busybox's, so that the host needs neither insmod nor ip.
# With `boot` in that folder systemd becomes the first process and runs the command as a unit (boot.sh).
run=$1
busybox=$run/tools/bin/busybox

$busybox mount -t hostfs -o "$run" none "$run" && cd "$run" || exec $busybox poweroff -f
exec >init.log 2>&1
$busybox mount -t proc proc /proc

modules=$run/tools/usr/lib/uml/modules/$($busybox uname -r)/kernel
for module in fs/overlayfs/overlay net/can/can net/can/can-raw net/can/can-bcm drivers/net/can/dev/can-dev \
    drivers/net/can/vcan net/sched/sch_tbf fs/autofs/autofs4; do
    $busybox insmod $modules/$module.ko
done
$busybox ip link set lo up
if [ ! -e boot ]; then
    $busybox ip link add dev vcan0 type vcan
    $busybox ip link set vcan0 up || exec $busybox poweroff -f
fi

# The command's root: the host's files, what it writes is kept in the guest's memory. /dev is the guest's own.
$busybox mkdir /dev/files
$busybox mount -t tmpfs tmpfs /dev/files
$busybox mkdir /dev/files/written /dev/files/work /dev/files/root
root=/dev/files/root
$busybox mount -t overlay -o lowerdir=/,upperdir=/dev/files/written,workdir=/dev/files/work overlay $root ||
    exec $busybox poweroff -f
[ -e boot ] && . ./boot.sh
$busybox mount -t proc proc $root/proc
$busybox mount -t sysfs sysfs $root/sys
$busybox mount -t devtmpfs devtmpfs $root/dev
$busybox mkdir -p $root/dev/pts $root/dev/shm
$busybox mount -t devpts -o mode=620,ptmxmode=666 devpts $root/dev/pts
$busybox mount -t tmpfs -o mode=1777 tmpfs $root/dev/shm
$busybox ln -s /proc/self/fd $root/dev/fd
$busybox ln -s fd/0 $root/dev/stdin
$busybox ln -s fd/1 $root/dev/stdout
$busybox ln -s fd/2 $root/dev/stderr
. ./mounts.sh

$busybox chroot $root /bin/sh "$run/command.sh" </dev/null >stdout 2>stderr
echo $? >exit-code.part
$busybox sync
$busybox mv exit-code.part exit-code
$busybox poweroff -f
