#!/usr/bin/env bash
# Seven processes on vcan0, one bit a message, agree on an altitude while you watch. Makes vcan0 if it
# is not there (as root, or with sudo), ends by itself, leaves nothing behind. ONEBIT_BUILD is the
# build folder, if it is not build/host.
set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
node=${ONEBIT_BUILD:-$here/build/host}/bin/onebit-node
scenario=$here/sim/scenarios/aircraft-fixed-broadcast.yaml
interface=vcan0
period=25ms
steps=600
agents=7

fail() {
    echo "demo.sh: $*" >&2
    exit 1
}

as_root() {
    if [ "$(id -u)" = 0 ]; then "$@"; else sudo "$@"; fi
}

folder=
made=
raised=
loaded=
processes=()
clean_up() {
    trap - EXIT INT TERM
    for process in "${processes[@]}"; do
        kill "$process" 2>/dev/null || true
    done
    wait
    [ -z "$made" ] || as_root ip link delete dev "$interface" 2>/dev/null || true
    [ -z "$raised" ] || as_root ip link set dev "$interface" down 2>/dev/null || true
    [ -z "$loaded" ] || as_root modprobe -r vcan 2>/dev/null || true
    [ -z "$folder" ] || rm -rf "$folder"
}
trap clean_up EXIT
trap 'exit 130' INT TERM

is_up() {
    [ "$(($(cat "/sys/class/net/$interface/flags") & 1))" = 1 ]
}

[ -x "$node" ] || fail "$node is not built: cmake --preset host && cmake --build --preset host"
command -v ip >/dev/null || fail "program ip is missing (Debian, Ubuntu: package iproute2)"
if [ ! -e "/sys/class/net/$interface" ]; then
    if [ ! -e /sys/module/vcan ] && as_root modprobe vcan 2>/dev/null; then
        loaded=yes
    fi
    as_root ip link add dev "$interface" type vcan 2>/dev/null ||
        fail "this kernel cannot make a vcan interface; '$node check --interface $interface' says why"
    made=yes
fi
if ! is_up; then
    as_root ip link set dev "$interface" up
    raised=yes
fi
"$node" check --interface "$interface" >/dev/null || "$node" check --interface "$interface"

folder=$(mktemp -d)
for agent in $(seq "$agents"); do
    "$node" "$scenario" --interface "$interface" --agent "$agent" --sync --arith q31 \
        --csv "$folder/$agent.csv" >"$folder/$agent.summary" 2>"$folder/$agent.err" &
    processes+=($!)
done
# A node writes the heading when its socket is open.
for agent in $(seq "$agents"); do
    for _ in $(seq 100); do
        [ -s "$folder/$agent.csv" ] && break
        kill -0 "${processes[$((agent - 1))]}" 2>/dev/null || fail "$(cat "$folder/$agent.err")"
        sleep 0.05
    done
done

echo "Seven onebit-node processes on $interface, a step each $period; candump $interface shows the bus."
echo "Every agent's number stands at its altitude; the same place: *."
echo
printf '%7s  %-61s  %s\n' step '0 m                      altitude                        5 m' 'spread'
"$node" "$scenario" --interface "$interface" --sync-master --period "$period" --steps "$steps" \
    >"$folder/master.summary" 2>"$folder/master.err" &
master=$!
processes+=("$master")

# The third state of the last whole row of each agent's CSV.
show() {
    for agent in $(seq "$agents"); do
        tail -n 2 "$folder/$agent.csv" | head -n 1
    done | awk -F, -v agents="$agents" '
        $1 == "step" { next }
        {
            ++count
            step = $1
            place = int($6 / 5 * 60 + 0.5)
            place = place < 0 ? 0 : place > 60 ? 60 : place
            at[place] = place in at ? "*" : NR
            sum += $6
            squares += $6 * $6
        }
        END {
            if (count < agents) exit # some have not made a step yet
            for (place = 0; place <= 60; ++place) line = line (place in at ? at[place] : ".")
            variance = squares / count - (sum / count) ^ 2
            printf "%7d  %s  %.3f m\n", step, line, sqrt(variance > 0 ? variance : 0)
        }'
}
while kill -0 "$master" 2>/dev/null; do
    show
    sleep 0.7
done
wait "$master" || fail "$(cat "$folder/master.err")"
for agent in $(seq "$agents"); do
    wait "${processes[$((agent - 1))]}" || fail "agent $agent: $(cat "$folder/$agent.err")"
done
show
echo
cat "$folder/master.summary" "$folder"/[1-9].summary
