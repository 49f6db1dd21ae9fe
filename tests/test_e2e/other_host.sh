#!/usr/bin/env bash
# By hand, as root: a client on a machine of its own (a network namespace with one cable) drives Gantry through `gantry-carla --bind`.
# Needs iproute2, the release binaries and the repository's Python environment.
set -euo pipefail
cd "$(dirname "$0")/../.."
bin=$PWD/target/release python=$PWD/.venv/bin/python script=$PWD/tests/test_e2e/python/carla_other_host.py
space=gantry_other_host work=$(mktemp -d)
end() {
    for pid in ${gateway:-} ${daemon:-}; do kill -TERM "$pid" 2> /dev/null && wait "$pid" || true; done
    ip netns del $space 2> /dev/null || true
    rm -rf "$work"
}
trap end EXIT
ip netns add $space
ip link add gantry_here type veth peer name gantry_there netns $space
ip addr add 198.51.100.1/24 dev gantry_here
ip link set gantry_here up
ip netns exec $space ip addr add 198.51.100.2/24 dev gantry_there
ip netns exec $space ip link set gantry_there up
cd "$work"
mkdir config
printf '[global]\nprefix = "other_host_"\n' > config/iceoryx2.toml
printf 'version = 1\n[scenario]\nmap = "Town10HD"\nseed = 7\ntick_hz = 20\nvehicles = 0\n' > launch.toml
"$bin/simd" --launch launch.toml --domain other_host > simd.log 2>&1 & daemon=$!
until grep -q ready simd.log; do sleep 0.2; kill -0 $daemon; done
serve() {
    "$bin/gantry-carla" --port 2700 --domain other_host "$@" > gateway.log 2>&1 & gateway=$!
    until grep -q 'listening on' gateway.log; do sleep 0.2; kill -0 $gateway; done
}
# Without --bind nobody else comes in.
serve
if ip netns exec $space timeout 3 bash -c 'exec 3<> /dev/tcp/198.51.100.1/2700' 2> /dev/null; then
    echo "the gateway answers other machines although nobody asked for that" >&2
    exit 1
fi
echo "refused without --bind"
kill -TERM $gateway
wait $gateway || true
serve --bind 198.51.100.1
HOME=$work ip netns exec $space "$python" "$script" 198.51.100.1 2700
