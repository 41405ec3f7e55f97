#!/bin/sh
# First process of the user-mode-linux guest that with_can.py boots: sets the guest up, runs the
# script `command` beside this file, leaves its exit status in `status` there and switches off.
# The root file system is the host's, read only; this file's folder is the one that can be written.
set -u
work=$(dirname "$0")
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin

# The kernel has opened its own console for this process; what goes wrong here is told there.
end() {
    sync
    mount -t proc proc /proc 2>/dev/null
    echo o >/proc/sysrq-trigger
    # Switching off is not immediate, and the kernel panics when its first process ends.
    while :; do sleep 1; done
}
need() {
    "$@" && return
    echo "guest.sh failed: $*"
    end
}

need mount -t proc proc /proc
need mount -t sysfs sysfs /sys
need mkdir -p /dev/pts /dev/shm
need mount -t devpts devpts /dev/pts
need mount -t tmpfs tmpfs /dev/shm
need mount -t tmpfs tmpfs /run
need mount -t hostfs -o "$work" none "$work"

# Sorted so that each finds the symbols of those before it.
for module in net/can/can net/can/can-raw net/can/can-bcm net/can/can-gw \
    drivers/net/can/dev/can-dev drivers/net/can/vcan drivers/net/can/vxcan \
    drivers/net/can/slcan/slcan net/sched/sch_tbf; do
    need insmod "/usr/lib/uml/modules/$(uname -r)/kernel/$module.ko"
done
need ip link set lo up

# The second console carries nothing but the command's output, as it is.
need stty -F /dev/tty1 -opost
sh "$work/command" >/dev/tty1 2>&1 </dev/null
echo $? >"$work/status"
# Changing a terminal waits until all before it is out.
stty -F /dev/tty1 opost
end
