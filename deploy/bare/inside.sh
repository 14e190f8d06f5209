#!/usr/bin/env bash
# Part of deploy/bare/run, in namespaces of its own: COMMAND as a plain user in $BARE_ROOT, beside $BARE_BUSY busy processes.
set -euo pipefail
root=$BARE_ROOT

mount --make-rprivate /
mount -t proc proc "$root/proc"
mount -t tmpfs -o mode=755 tmpfs "$root/dev"
for device in null zero full random urandom tty; do
  touch "$root/dev/$device"
  mount --bind "/dev/$device" "$root/dev/$device"
done
ln -s /proc/self/fd "$root/dev/fd"
mkdir "$root/dev/pts"
mount -t devpts -o newinstance,ptmxmode=0666,mode=620 devpts "$root/dev/pts"
ln -s pts/ptmx "$root/dev/ptmx"
mkdir "$root/dev/shm"
mount -t tmpfs -o mode=1777 tmpfs "$root/dev/shm"
mount --bind -o ro /sys "$root/sys"
while IFS= read -r path; do
  if [ -z "$path" ]; then continue; fi
  if [ -d "$path" ]; then
    mkdir -p "$root$path"
  else
    mkdir -p "$root$(dirname "$path")"
    touch "$root$path"
  fi
  mount --bind -o ro "$path" "$root$path"
done <<<"$BARE_BINDS"
ip link set lo up
for ((i = 0; i < BARE_BUSY; i++)); do
  (while :; do :; done) &
done

variables=(PATH=/usr/bin:/bin HOME=/home/stranger LANG=C.UTF-8)
while IFS= read -r variable; do variables+=("$variable"); done < <(env | grep '^PIP_')
ulimit -r 0
ulimit -l 64 # kB; 8 MB are usual, and enough for no process of ours
chroot "$root" setpriv --reuid nobody --regid nogroup --clear-groups --no-new-privs --bounding-set -all \
  env -i "${variables[@]}" bash -c 'cd ~/clutch-hil && exec "$@"' bash "$@"
