# Part of init.sh: makes systemd the guest's first process, without the units of the host. $run, $busybox and $root are init.sh's.
# What `image` of the run has is laid over the guest's root before. The command is a unit of its own, `can-guest.service`.

$busybox rm -rf $root/etc/systemd/system $root/etc/fstab
$busybox rm -f $root/etc/machine-id  # may be a link
$busybox tr -d - </proc/sys/kernel/random/uuid >$root/etc/machine-id  # without one systemd enables what presets say
$busybox mkdir -p $root/etc/systemd/system/multi-user.target.wants $root/run
[ -e image ] && $busybox cp -a image/. $root/ && $busybox chmod 755 $root  # whatever the folder's own mode is
units=$root/etc/systemd/system
$busybox ln -s /lib/systemd/system/multi-user.target $units/default.target
# what waits for hardware, for a network or for people, of which a guest has none, and what the host's programs brought
for unit in getty.target systemd-timesyncd.service systemd-logind.service systemd-update-utmp.service systemd-firstboot.service \
    systemd-random-seed.service systemd-binfmt.service systemd-hwdb-update.service systemd-udev-trigger.service \
    systemd-tmpfiles-clean.timer systemd-modules-load.service systemd-machine-id-commit.service systemd-journal-flush.service \
    avahi-daemon.service avahi-daemon.socket proc-sys-fs-binfmt_misc.automount; do
    $busybox ln -s /dev/null $units/$unit
done
$busybox rm -f $root/lib/systemd/system/multi-user.target.wants/* $root/lib/systemd/system/timers.target.wants/*
for generator in $root/lib/systemd/system-generators/*; do
    case $generator in */systemd-*) ;; *) $busybox rm -f $generator ;; esac
done
for folder in tmp var/tmp; do
    $busybox mount -t tmpfs -o mode=1777 tmpfs $root/$folder
done
$busybox cat >$units/can-guest.service <<END
[Unit]
Description=The command of can_guest.py
After=basic.target
[Service]
Type=exec
ExecStart=/bin/sh $run/command.sh
ExecStopPost=/bin/sh -c 'echo \$EXIT_STATUS >$run/exit-code.part; sync; mv $run/exit-code.part $run/exit-code'
ExecStopPost=-systemctl --force --force poweroff
StandardOutput=append:$run/stdout
StandardError=append:$run/stderr
StandardInput=null
END
$busybox ln -s ../can-guest.service $units/multi-user.target.wants/can-guest.service
$busybox mkdir -p $root$run
$busybox mount -t hostfs -o "$run" none "$root$run"
. ./mounts.sh
# the guest's first root stays below /run, where systemd mounts over it
$busybox mkdir -p $root/run/first
cd $root && $busybox pivot_root . run/first || exec $busybox poweroff -f
exec run/first$run/tools/bin/busybox chroot . /lib/systemd/systemd --show-status=no </dev/null >$run/init.log 2>&1
